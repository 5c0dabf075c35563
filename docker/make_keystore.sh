#!/usr/bin/env bash
# Make an experiment's keystore, once, and give each process its own part: its keys and nothing else's.
# usage: make_keystore.sh EXPERIMENT AUTHORITY KEYS     (in the image: mabirds-make-keystore)
#   AUTHORITY   directory of the keystore, with the keys that vouch for everybody
#   KEYS        directory with one directory per process, named like its enclave, to be filled
# KEYSTORE_OWNER: who is to own these (1000:1000), where this runs as root.
set -euo pipefail
if [ $# -ne 3 ]; then
  sed -n 2,6p "$0" >&2
  exit 2
fi
experiment=$1 keystore=$2/keystore keys=$3
if [ -d "$keystore" ]; then
  echo "$keystore is there already; to make new keys, remove the volumes"
else
  mabirds security create "$experiment" --keystore "$keystore"
fi
for place in "$keys"/*/; do
  name=$(basename "$place")
  cp --dereference --recursive "$keystore/enclaves/$name/." "$place"
  if [ "$(id -u)" = 0 ]; then
    chown -R "${KEYSTORE_OWNER:-1000:1000}" "$place"
  fi
done
