#!/usr/bin/env bash
# Makes the documentation, warnings being errors:  bash .ci/docs.sh PYTHON FOLDER
# PYTHON has palpate and the dependency group `docs`. Nothing is fetched.
set -euo pipefail
cd "$(dirname "$0")/.."
python="$1" folder="$2"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
cp -r validation/documentation/. "$work"
# On a site the scoreboard's pages lie beside these (`make site`).
if [ -n "${PALPATE_SITE:-}" ]; then
    printf '\n<p><a href="scoreboard/index.html">The scoreboard: every simulator on every case</a></p>\n' \
        >>"$work/index.md"
fi
PYTHONPATH="$PWD/validation/documentation${PYTHONPATH:+:$PYTHONPATH}" \
    "$python" -m making "$work"
"$python" -m sphinx -q -W --keep-going -j auto -d "$work/doctrees" -c "$work/making" -b html \
    "$work" "$folder"
# The same list of commands as a man page: palpate.1.
mkdir "$work/man"
cp "$work/made/commands.md" "$work/man"
version="$("$python" -c 'from importlib.metadata import version; print(version("palpate"))')"
"$python" -m sphinx -q -W -C -b man -D extensions=myst_parser -D root_doc=commands -D project=palpate \
    -D "release=$version" -D "author=the palpate developers" "$work/man" "$folder/man"
mv "$folder/man/palpate.1" "$folder/palpate.1"
rm -rf "$folder/man"
echo "docs: $folder/index.html"
