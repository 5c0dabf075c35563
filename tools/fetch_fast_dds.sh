#!/usr/bin/env bash
# Unpack Debian's Fast DDS with its headers below DIRECTORY, without installing it: the tests of keystores compile a
# peer with it, since it has DDS Security. (Installed, its headers would get in the way of mabirds_msgs.)
# usage: tools/fetch_fast_dds.sh DIRECTORY
set -euo pipefail
if [ $# -ne 1 ]; then
  sed -n 2,4p "$0" >&2
  exit 2
fi
mkdir -p "$1"
cd "$1"
if [ -d usr/include/fastdds ]; then
  exit 0
fi
apt-get update -qq
apt-get download -qq libfastrtps2.9 libfastrtps-dev libfastcdr1 libfastcdr-dev libfoonathan-memory0.7.2 \
  libfoonathan-memory-dev libtinyxml2-9 libtinyxml2-dev libasio-dev
for package in ./*.deb; do
  dpkg -x "$package" .
done
rm ./*.deb
