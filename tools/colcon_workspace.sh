#!/usr/bin/env bash
# Build ros_ws with colcon, as on a stock ROS installation but with ROS from pip wheels, and see one message go from a
# learner of the install tree to another process.
# usage: tools/colcon_workspace.sh [PYTHON]    (everything lands in build/colcon and ros_ws/{build,install,log})
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD python=${1:-python3} place=build/colcon
unset AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH PYTHONPATH VIRTUAL_ENV _ROS_WHEELS_BOOTSTRAP_COMPLETE

echo "== an environment with colcon, the wheels of ROS and what the packages need"
[ -x $place/bin/python ] || "$python" -m venv $place
. $place/bin/activate
mapfile -t build_tools < <(python -c 'import tomllib
print(*tomllib.load(open("ros_ws/src/mabirds_msgs/pyproject.toml", "rb"))["build-system"]["requires"], sep="\n")')
# colcon is older than the setuptools that everything else is built with.
grep -v '^setuptools==' constraints.txt >$place/constraints.txt
pip install --quiet --disable-pip-version-check --constraint $place/constraints.txt \
  --requirement requirements.txt "${build_tools[@]}" cmake colcon-common-extensions

echo "== colcon build"
export AMENT_PREFIX_PATH=$VIRTUAL_ENV # the wheels do not say where they are
cd ros_ws
colcon build --event-handlers console_direct- desktop_notification-

echo "== a node of the install tree, heard by another process"
set +u # colcon's scripts look at variables that may be unset
. install/setup.bash
set -u
export ROS_DOMAIN_ID=${ROS_DOMAIN_ID:-42} ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
install/mabirds_learner/lib/mabirds_learner/learner --ros-args -r __ns:=/learner_1 \
  -p experiment:="$root/ros_ws/config/patrol.yaml" &
learner=$!
trap 'kill $learner 2>/dev/null || true' EXIT
heard=$(install/mabirds_bringup/lib/mabirds_bringup/mabirds inspect --once --timeout 20 2>&1) || true
echo "$heard"
case $heard in
*"/learner_1 parameters 1: "*) echo "heard" ;;
*) echo "error: nothing was heard of learner_1 within 20 s" >&2 && exit 4 ;;
esac
