#!/usr/bin/env bash
# Format, style and types: ruff, clang-format, mypy --strict, and a build without warnings.
set -euo pipefail
cd "$(dirname "$0")/.."
bin="${VENV:-.venv}/bin"
"$bin/ruff" check .
"$bin/ruff" format --check .
git ls-files '*.cpp' '*.hpp' | xargs "$bin/clang-format" --dry-run -Werror
if [ -n "${PALPATE_WERROR:-}" ]; then # the set-up has built so already
    bash .ci/view.sh --links
else
    bash .ci/view.sh "$bin/python" -DPALPATE_WERROR=ON
fi
MYPYPATH=build/view:validation/documentation "$bin/mypy" -p palpate -p making
