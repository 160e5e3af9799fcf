#!/usr/bin/env bash
# Tests of the Python package, in a virtual environment under target/:
#
#     python/test.sh [ARGUMENTS OF PYTEST...]
#
# Reads the frozen files as formats.md says, with a reader in Python alone (tests/foreign).
# Builds the package with the optimisation of the project's own tests, installs it, writes its documentation to
# target/python-doc, checks the types of the package and of an example, and runs the tests. Needs Python 3.11 or newer, Rust, and on the first run a way to the packages that
# tests/requirements.txt names. The program that answers are compared with is built, too.
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

# (Programs of the environment first, as where it is activated.)
export PATH=$venv/bin:$PATH VIRTUAL_ENV=$venv CARGO_TARGET_DIR=$target

# What needs nothing that is built: a reader of the file formats, written from formats.md alone. (Beside all that follows.)
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
# (The package has the features that the program has, so that Cargo uses the library that is compiled already.)
maturin build --manifest-path python/Cargo.toml --profile dev --locked --out "$wheels" --interpreter "$venv/bin/python"
pip install --quiet --disable-pip-version-check --force-reinstall --no-deps "$wheels"/*.whl

# (Warnings of the documentation, such as of a name that there is not, are errors.)
(cd "$target" && python -P -W error -m pdoc --output-directory "$target/python-doc" spinney)
# The stubs of the native part are those of what is there.
(cd "$target" && python -P -m mypy.stubtest spinney._native --ignore-missing-stub)

foreign_failed=0
wait "$foreign" || foreign_failed=1
cat "$said"
[ "$foreign_failed" = 0 ]

cd python
mypy
mypy --config-file pyproject.toml examples/typed.py
# (From a folder of its own, so that the package that was installed is the one that is tested.)
pytest --rootdir . -c pyproject.toml -p no:cacheprovider -q "$@" tests
