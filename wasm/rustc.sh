#!/usr/bin/env bash
# rustc as `build.sh` runs it. Cargo derives the metadata of path dependencies from their directories, and symbols, thus the order of
# functions in the module, from the metadata. So that this is the same everywhere, the project's crates have metadata by name.
compiler=$1
shift
arguments=()
for argument; do
    case ${CARGO_PKG_NAME:-}/$argument in
    spinney-*/metadata=*) argument=metadata=$CARGO_PKG_NAME-$CARGO_CRATE_NAME ;;
    esac
    arguments+=("$argument")
done
exec "$compiler" "${arguments[@]}"
