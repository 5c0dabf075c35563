#!/usr/bin/env bash
# Build and test ros_ws with colcon, as on a stock ROS installation but with ROS from pip wheels, and see one message go
# from a learner of the install tree to another process.
# usage: tools/colcon_workspace.sh [PYTHON]    (everything lands in build/colcon and ros_ws/{build,install,log})
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD place=$PWD/build/colcon tree=$PWD/ros_ws/install
export PYTHON=${1:-python3} MABIRDS_INSTALL=$tree
unset AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH PYTHONPATH ROS_DISTRO VIRTUAL_ENV
unset _ROS_WHEELS_BOOTSTRAP_COMPLETE

echo "== an environment with colcon, the wheels of ROS and what the packages need"
mapfile -t build_tools < <("$PYTHON" -c 'import tomllib
print(*tomllib.load(open("ros_ws/src/mabirds_msgs/pyproject.toml", "rb"))["build-system"]["requires"], sep="\n")')
docker/install_python.sh "$place" --requirement requirements.txt "${build_tools[@]}" cmake colcon-common-extensions

echo "== colcon build"
rm -rf "$tree" # of another Python, or of what is no longer there
docker/build_workspace.sh "$place" "$tree"

echo "== colcon test"
cd ros_ws
(
  # shellcheck source=/dev/null
  . "$place/bin/activate" && set +u && . "$tree/setup.bash" # which looks at variables that may be unset
  export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
  python "$(command -v colcon)" test --return-code-on-test-failure --event-handlers console_cohesion+ \
    desktop_notification-
  colcon test-result --verbose
)
cd "$root"

echo "== what is installed"
share=$tree/mabirds_bringup/share/mabirds_bringup
for file in "$share"/launch/experiment.launch.py "$share"/config/{patrol,drones}.yaml; do
  cmp "$file" "ros_ws/${file#"$share/"}"
done
for program in mabirds_learner/lib/mabirds_learner/learner mabirds_expert_player/lib/mabirds_expert_player/expert_player
do
  docker/entrypoint.sh "$tree/$program" --help | head -1
done

echo "== a node of the install tree, heard by another process"
PATH=$place/bin:$PATH docker/entrypoint.sh docker/hear_learner.sh ros_ws/config/patrol.yaml
