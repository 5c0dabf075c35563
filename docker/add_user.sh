#!/usr/bin/env bash
# Add the user mabirds, and the directories that are its own. For images, as root.
# usage: add_user.sh
set -euo pipefail
if id ubuntu >/dev/null 2>&1; then # Ubuntu's images have one with this number
  userdel --remove ubuntu
fi
useradd --uid 1000 --create-home mabirds
# A new volume gets the owner of the directory that it is mounted at.
install --directory --owner mabirds --group mabirds /srv/mabirds /srv/mabirds/{bags,checkpoints,runs}
