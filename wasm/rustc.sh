#!/usr/bin/env bash
# rustc as run by `build.sh`, so that the module does not depend on the directory of the checkout.
#
# - Arguments in SPINNEY_RUSTC_ARGUMENTS (one per line) are added here, because Cargo hashes
#   RUSTFLAGS into file names, by which link-time optimization sorts versions of a crate.
# - Cargo derives the metadata of path dependencies from their directories, and rustc derives
#   symbols from the metadata. So the metadata of the project's crates is set to their names.
compiler=$1
shift
mapfile -t arguments <<< "$SPINNEY_RUSTC_ARGUMENTS"
for argument; do
    case ${CARGO_PKG_NAME:-}/$argument in
    spinney-*/metadata=*) argument=metadata=$CARGO_PKG_NAME-$CARGO_CRATE_NAME ;;
    esac
    arguments+=("$argument")
done
exec "$compiler" "${arguments[@]}"
