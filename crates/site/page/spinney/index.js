// Spinney: answers from tree files, wherever they are.

export { open, Dataset, Model } from "./dataset.js";
export { setModule } from "./engine.js";
export { PanicError, SpinneyError } from "./errors.js";
export { openInWorker, setWorker } from "./remote.js";
