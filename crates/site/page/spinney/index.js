// Spinney: queries of tree files, local or remote.

export { open, Dataset, Model } from "./dataset.js";
export { setModule } from "./engine.js";
export { PanicError, SpinneyError } from "./errors.js";
export { openInWorker, setWorker } from "./remote.js";
