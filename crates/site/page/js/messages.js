// Messages for users of the page.
//
// Errors and remarks are the engine's, whose other users have a command line, a library or a
// package. Only this file replaces their advice by what can be done in a page.

/** Commands, options, operations, functions and settings, which a page does not have. */
const FOREIGN = /\bspinney[\s.]+[a-z]|(?<![\w-])--[a-z]|\bin Python\b|\b(?:crs|like|calc|raster)=|\bSPINNEY_|\b[\w.]+\(\)|\bDataset[.:]/;

/** Advice by the kind of an error. */
const ADVICE = {
  "no-tree": "this page opens .goblin and .autumn files",
  changed: "reload the page to see the file as it is now",
  "too-large": "zoom in, or choose a smaller area",
};

/** Advice where the engine's does not apply to a page. */
const OTHERWISE = "the author of the file can change this";

/** Contents of files that no page shows, as named in errors. */
const HIDDEN_CONTENTS = [[/\ba tree of points\b/, "points"], [/\ba tree of lines\b/, "lines"], [/\ba shard summary\b/, "shard"]];

/** Names of contents that no page shows. */
const CONTENT_NAMES = { points: "points", lines: "lines", shard: "a part of an unfinished build" };

/** Whether the page shows files of a content; `true` for unknown content. */
export function isShown(content) {
  return !Object.hasOwn(CONTENT_NAMES, content ?? "");
}

/** The message that a file has a content that the page does not show. */
export function notShown(name, content) {
  return `${name}: has ${CONTENT_NAMES[content]}, which this page does not show; it shows maps, volumes and exact models`;
}

/**
 * A message without sentences and clauses that mention what the page does not have. In the first
 * sentence, which describes the failure, the first clause stays; often it is the name of a file.
 */
export function withoutForeign(message) {
  const [first, ...others] = message.split(/(?=(?:;|(?<=[^.])\.)\s)/);
  const clauses = first.split(/(?=:\s)/);
  const end = clauses.findIndex((clause, at) => at > 0 && FOREIGN.test(clause));
  return [...clauses.slice(0, end < 0 ? clauses.length : end), ...others.filter((sentence) => !FOREIGN.test(sentence))].join("");
}

/** The message of an error. */
export function messageOf(error) {
  const message = String(error?.message ?? error);
  const { code, file, found } = error ?? {};
  const hidden = code === "unsupported" && HIDDEN_CONTENTS.find(([pattern]) => pattern.test(found));
  if (hidden) return notShown(file, hidden[1]);
  const advice = ADVICE[code];
  const kept = withoutForeign(advice ? message.split("; ")[0] : message);
  if (advice) return `${kept}; ${advice}`;
  return kept === message ? message : `${kept}; ${OTHERWISE}`;
}
