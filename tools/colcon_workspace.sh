#!/usr/bin/env bash
# Build and test ros_ws with colcon, as on a stock ROS installation but with ROS from pip wheels, and see one message go
# from a learner of the install tree to another process.
# usage: tools/colcon_workspace.sh [PYTHON]    (everything lands in build/colcon)
set -euo pipefail
cd "$(dirname "$0")/.."
place=$PWD/build/colcon tree=$PWD/build/colcon/install
export PYTHON=${1:-python3} MABIRDS_INSTALL=$tree COLCON_LOG_PATH=$place/log
unset AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH PYTHONPATH ROS_DISTRO VIRTUAL_ENV
unset _ROS_WHEELS_BOOTSTRAP_COMPLETE

echo "== an environment with colcon, the wheels of ROS and what the packages need"
mapfile -t build_tools < <("$PYTHON" -c 'import tomllib
print(*tomllib.load(open("ros_ws/src/mabirds_msgs/pyproject.toml", "rb"))["build-system"]["requires"], sep="\n")')
docker/install_python.sh "$place" --requirement requirements.txt "${build_tools[@]}" cmake colcon-common-extensions

echo "== colcon build"
rm -rf "$tree" # what is no longer in the sources must not be found there
docker/build_workspace.sh "$place" "$tree" --build-base "$place/build"

export AMENT_PREFIX_PATH=$place # ROS's wheels do not say where they are
echo "== colcon test"
(
  cd ros_ws
  set +u # colcon's scripts look at variables that may be unset
  # shellcheck source=/dev/null
  . "$place/bin/activate" && . "$tree/setup.bash"
  export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
  python "$(command -v colcon)" test --build-base "$place/build" --install-base "$tree" \
    --event-handlers console_cohesion+ desktop_notification-
  colcon test-result --test-result-base "$place/build" --verbose
  cd ..
  echo "== the messages are those that pip builds, by their type hashes"
  python -m pytest -q -p no:cacheprovider tests/msgs_py/test_type_hashes.py
)

echo "== what is installed"
share=$tree/mabirds_bringup/share/mabirds_bringup
for file in "$share"/launch/experiment.launch.py "$share"/config/{patrol,drones}.yaml; do
  cmp "$file" "ros_ws/${file#"$share/"}"
  echo "$file"
done
for program in learner baseline expert-player; do
  package=${program/baseline/learner}
  package=mabirds_${package/-/_}
  said=$(PATH=$place/bin:$PATH docker/entrypoint.sh "$tree/$package/lib/$package/mabirds-$program" --help)
  echo "$program: ${said%%$'\n'*}"
done

echo "== a node of the install tree, heard by another process"
PATH=$place/bin:$PATH docker/entrypoint.sh docker/hear_learner.sh ros_ws/config/patrol.yaml
