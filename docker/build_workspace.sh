#!/usr/bin/env bash
# Build ros_ws with colcon, for the Python of a virtual environment that install_python.sh made.
# usage: build_workspace.sh VENV INSTALL [COLCON ARGUMENT ...]
set -eo pipefail # not -u: ROS's scripts look at variables that may be unset
if [ $# -lt 2 ]; then
  sed -n 2,3p "$0" >&2
  exit 2
fi
venv=$(cd "$1" && pwd) install=$(realpath -m "$2")
shift 2
cd "$(dirname "$0")/../ros_ws"
# shellcheck source=/dev/null
. "$venv/bin/activate"
if [ -n "${ROS_DISTRO:-}" ]; then
  # shellcheck source=/dev/null
  . "/opt/ros/$ROS_DISTRO/setup.bash"
else
  export AMENT_PREFIX_PATH=$venv # ROS's wheels do not say where they are
fi
# By this Python, whichever brought colcon: programs are installed for the Python that colcon runs on.
python "$(command -v colcon)" build --install-base "$install" --event-handlers console_direct- desktop_notification- \
  "$@"
