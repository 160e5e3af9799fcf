// The link to the place that is shown: what stands behind the `#` of the page's address.

/** The place that the address tells: file, layer, commit, style, hidden classes, and where one looks from. */
export function readPlace() {
  return Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
}

/** Puts a place into the address, without a step of the history for each move. */
export function writePlace(place) {
  const said = Object.entries(place).filter(([, value]) => value !== undefined && value !== "" && value !== null);
  const hash = new URLSearchParams(said.map(([name, value]) => [name, String(value)])).toString();
  history.replaceState(null, "", hash ? `#${hash}` : location.pathname + location.search);
}

/** Changes some of it. */
export function changePlace(changes) {
  writePlace({ ...readPlace(), ...changes });
}
