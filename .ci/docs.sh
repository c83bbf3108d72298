#!/usr/bin/env bash
# Makes the documentation, warnings being errors:  bash .ci/docs.sh PYTHON FOLDER
# PYTHON has palpate and the dependency group `docs`. Nothing is fetched.
set -euo pipefail
cd "$(dirname "$0")/.."
python="$1" folder="$2"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
cp -r validation/documentation/. "$work"
"$python" validation/documentation/made_pages.py "$work"
"$python" -m sphinx -q -W --keep-going -b html "$work" "$folder"
echo "docs: $folder/index.html"
