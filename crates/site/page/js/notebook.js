// The page embedded in another one, as in a notebook, which reads ranges of the file and receives
// drawn polygons.

const asked = new Map();
let next = 0;

addEventListener("message", ({ source, data }) => {
  if (source !== parent || !asked.has(data?.range)) return;
  const { resolve, reject } = asked.get(data.range);
  asked.delete(data.range);
  if (data.failure === undefined) resolve(new Uint8Array(data.bytes));
  else reject(new Error(data.failure));
});

/** Reads a range of the file. */
export function readFromParent(start, end) {
  return new Promise((resolve, reject) => {
    next += 1;
    asked.set(next, { resolve, reject });
    tellParent({ range: next, start, end });
  });
}

/** Sends a message to the enclosing page, if there is one. */
export function tellParent(message) {
  if (parent !== window) parent.postMessage({ spinney: message }, "*");
}
