#!/usr/bin/env bash
# Tests the page in headless Chromium, controlled by playwright-core. Installs Chromium if it is
# missing and can be installed (as root, by apt-get):
#
#     crates/site/test.sh
#
# Needs the program as target/debug/spinney, or its path in SPINNEY. Skips the tests without npm or
# Chromium.
set -euo pipefail
cd "$(dirname "$0")"
skip() {
    echo "skipped: tests of the page: $*"
    exit 0
}
command -v npm > /dev/null || skip 'there is no npm'
export CHROMIUM=${CHROMIUM:-$(command -v chromium || command -v chromium-browser || command -v google-chrome || true)}
if [ -z "$CHROMIUM" ] && [ "$(id -u)" = 0 ] && command -v apt-get > /dev/null; then
    { apt-get -qq update && DEBIAN_FRONTEND=noninteractive apt-get -qq install --no-install-recommends chromium; } > /dev/null 2>&1 || true
    CHROMIUM=$(command -v chromium || true)
fi
[ -n "$CHROMIUM" ] || skip 'there is no Chromium'
# (Node resolves modules from a script's directory upwards. Hence the tests are copied to the
# directory that playwright-core is installed in.)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp test/*.mjs "$work"
npm install --silent --no-audit --no-fund --prefix "$work" playwright-core@1.64.1
export SPINNEY_ROOT=$PWD/../..
node --test --test-reporter=spec "$work"/*.test.mjs
