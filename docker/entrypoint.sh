#!/usr/bin/env bash
# Run a command with ROS and the packages of an install tree at hand; in the image it is mabirds-entrypoint.
# usage: entrypoint.sh COMMAND [ARGUMENT ...]     (MABIRDS_INSTALL: the tree that colcon made)
set -eo pipefail # not -u: colcon's scripts look at variables that may be unset
if [ $# -eq 0 ]; then
  sed -n 2,3p "$0" >&2
  exit 2
fi
tree=${MABIRDS_INSTALL:-/opt/mabirds/install}
if [ -f "$tree/setup.bash" ]; then
  # shellcheck source=/dev/null
  . "$tree/setup.bash" # and of ROS, whose setup it remembers
  for package in mabirds_learner mabirds_expert_player mabirds_bringup; do
    PATH=$tree/$package/lib/$package:$PATH
  done
fi
exec "$@"
