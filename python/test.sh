#!/usr/bin/env bash
# Tests of the Python package, in a virtual environment under target/:
#
#     python/test.sh [ARGUMENTS OF PYTEST...]
#
# Reads the frozen files with an independent reader in Python, which implements formats.md
# (tests/foreign). Builds the package with the optimisation of the project's own tests, installs it,
# writes its documentation to target/python-doc, type-checks the package and an example, and runs
# the tests. Also builds the program, with whose results the package's are compared. Needs Python
# 3.11 or newer, Rust, and on the first run access to the packages in tests/requirements.txt.
set -euo pipefail
cd "$(dirname "$0")/.."
target=${CARGO_TARGET_DIR:-$PWD/target}
python=${PYTHON:-python3}

if ! "$python" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2> /dev/null; then
    echo "$0: Python 3.11 or newer with venv is needed as $python (PYTHON names another one); on Debian: apt-get install python3-venv" >&2
    exit 1
fi

venv=$target/python-venv
if ! cmp -s python/tests/requirements.txt "$venv/requirements.txt"; then
    rm -rf "$venv"
    "$python" -m venv "$venv"
    "$venv/bin/pip" install --quiet --no-compile --disable-pip-version-check -r python/tests/requirements.txt
    cp python/tests/requirements.txt "$venv/"
fi

# (Programs of the environment first, as if it were activated.)
export PATH=$venv/bin:$PATH VIRTUAL_ENV=$venv CARGO_TARGET_DIR=$target

# The independent reader of the file formats needs no build, so it runs in parallel with all that
# follows.
foreign() {
    (cd tests/foreign && mypy --strict --allow-untyped-calls --no-warn-return-any --cache-dir "$target/mypy-foreign" ./*.py)
    exec python -m pytest -p no:cacheprovider -q tests/foreign
}
said=$(mktemp)
foreign > "$said" 2>&1 &
foreign=$!
ended() {
    kill "$foreign" 2> /dev/null || true
    rm -f "$said"
}
trap ended EXIT

cargo build --locked --features remote --bin spinney
export SPINNEY_PROGRAM=$target/debug/spinney
wheels=$target/python-wheels
rm -rf "$wheels"
# (The package has the features that the program has, so that Cargo uses the library that is
# compiled already.)
maturin build --manifest-path python/Cargo.toml --profile dev --locked --out "$wheels" --interpreter "$venv/bin/python"
pip install --quiet --disable-pip-version-check --force-reinstall --no-deps "$wheels"/*.whl

# (Warnings of the documentation generator, such as an unknown name, are errors.)
(cd "$target" && python -P -W error -m pdoc --output-directory "$target/python-doc" spinney)
# The type stubs of the native module must match it.
(cd "$target" && python -P -m mypy.stubtest spinney._native --ignore-missing-stub)

foreign_failed=0
wait "$foreign" || foreign_failed=1
cat "$said"
[ "$foreign_failed" = 0 ]
# (The run in parallel skips what needs the program.)
python -m pytest -p no:cacheprovider -q tests/foreign/test_manifest.py tests/foreign/test_levels.py

cd python
mypy
mypy --config-file pyproject.toml examples/typed.py
# (In another directory, so that the installed package is tested.)
pytest --rootdir . -c pyproject.toml -p no:cacheprovider -q "$@" tests
