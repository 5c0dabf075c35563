#!/usr/bin/env bash
# Start a learner and hear it from another process: is the installation whole? (in the image: mabirds-hear-learner)
# usage: entrypoint.sh hear_learner.sh EXPERIMENT     (one that has a learner_1)
set -euo pipefail
experiment=$(realpath "${1:?usage: hear_learner.sh EXPERIMENT}")
export ROS_DOMAIN_ID=${ROS_DOMAIN_ID:-42} ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
echo "$(command -v mabirds-learner), heard by $(command -v mabirds)"
mabirds-learner --ros-args -r __ns:=/learner_1 -p experiment:="$experiment" &
learner=$!
trap 'kill $learner 2>/dev/null || true' EXIT
heard=$(mabirds inspect --once --timeout 20 2>&1) || true
echo "$heard"
case $heard in
*"/learner_1 parameters 1: "*) echo "heard" ;;
*) echo "error: nothing was heard of learner_1 within 20 s" >&2 && exit 4 ;;
esac
