#!/usr/bin/env bash
# Install what apt has: of ROS, of Python, and to build with. For images that bring ROS's package sources, as root.
# usage: install_ros.sh build|runtime
set -euo pipefail
packages=(
  "ros-$ROS_DISTRO-common-interfaces"
  "ros-$ROS_DISTRO-rclpy"
  "ros-$ROS_DISTRO-rmw-fastrtps-cpp"
  "ros-$ROS_DISTRO-rosbag2-storage-mcap"
  python3
)
case ${1:-} in
build) packages+=("ros-$ROS_DISTRO-rosidl-default-generators" build-essential python3-colcon-common-extensions
  python3-dev python3-venv) ;;
runtime) ;;
*) sed -n 2,3p "$0" >&2 && exit 2 ;;
esac
apt-get update
apt-get install --yes --no-install-recommends "${packages[@]}"
rm -rf /var/lib/apt/lists/*
