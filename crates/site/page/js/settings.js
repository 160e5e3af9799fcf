// Settings that are kept in links: what follows `#` in the page's address.

/** The configuration's settings for the current file. */
let configured = {};
/** Current settings: file, layer, commit, grid, style, hidden classes, opacity, section, view. */
let current = {};

const isSet = (value) => value !== undefined && value !== null && value !== "";

const onlySet = (settings) => Object.fromEntries(Object.entries(settings).filter(([, value]) => isSet(value)));

/**
 * The settings in the address. An empty one overrides the configuration's, so that the file's own
 * applies.
 */
export function readSettings() {
  return Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
}

/** Settings of a file: those of the configuration, replaced by others. */
export function joined(ofConfiguration, others) {
  return onlySet({ ...ofConfiguration, ...others });
}

/** Starts with the settings of a file. */
export function startSettings(ofConfiguration, settings) {
  configured = onlySet(ofConfiguration);
  current = onlySet(settings);
  write();
}

/** The current settings. */
export function currentSettings() {
  return { ...current };
}

/** The style of the configuration, if it has one. */
export function configuredStyle() {
  return configured.style;
}

/** Changes some settings; `undefined` removes one. */
export function changeSettings(changes) {
  current = onlySet({ ...current, ...changes });
  write();
}

/**
 * Writes the differences from the configuration to the address, without adding an entry to the
 * browser's history.
 */
function write() {
  const settings = new URLSearchParams();
  for (const [name, value] of Object.entries(current)) {
    if (String(value) !== String(configured[name])) settings.set(name, String(value));
  }
  for (const name of Object.keys(configured)) {
    if (!(name in current)) settings.set(name, "");
  }
  const hash = settings.size ? `#${settings}` : "";
  if (hash !== location.hash) history.replaceState(null, "", location.href.split("#")[0] + hash);
}
