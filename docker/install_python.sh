#!/usr/bin/env bash
# Install what pip has, at the versions of constraints.txt, into a virtual environment; it sees ROS where apt brought it.
# usage: install_python.sh VENV [PIP ARGUMENT ...]     (PYTHON: python3; TORCH_INDEX_URL: also look for torch there)
set -euo pipefail
cd "$(dirname "$0")/.."
venv=${1:?usage: install_python.sh VENV [PIP ARGUMENT ...]}
shift
options=()
if [ -n "${ROS_DISTRO:-}" ]; then
  options=(--system-site-packages)
fi
[ -x "$venv/bin/python" ] || "${PYTHON:-python3}" -m venv ${options[@]+"${options[@]}"} "$venv"
# Not what is for development, nor the wheels of ROS. colcon is older than the pinned setuptools; that of apt is older
# than licences in pyproject.toml.
sed -e '/^# Development/,$d' -e '/^ros-jazzy-/d' requirements.txt >"$venv/requirements.txt"
grep -v '^setuptools==' constraints.txt >"$venv/constraints.txt"
if [ -n "${TORCH_INDEX_URL:-}" ]; then
  export PIP_EXTRA_INDEX_URL="${PIP_EXTRA_INDEX_URL:-} $TORCH_INDEX_URL"
fi
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check \
  --constraint "$venv/constraints.txt" --requirement "$venv/requirements.txt" "setuptools>=77,<80" "$@"
