// Byte ranges, joined if they are close to each other.

/** Maximum gap in bytes between two ranges that are fetched as one. */
const GAP = 32 * 1024;
/** Maximum bytes per request, unless a single range is larger. */
const MAX_JOINED = 8 * 2 ** 20;

/** Joins ranges with small gaps, to at most `most` bytes each. */
export function join(ranges, gap = GAP, most = MAX_JOINED) {
  const joined = [];
  for (const [start, end] of [...ranges].sort((a, b) => a[0] - b[0] || b[1] - a[1])) {
    const last = joined.at(-1);
    if (last && start <= last[1] + gap && (end <= last[1] || end - last[0] <= most)) {
      last[1] = Math.max(last[1], end);
    } else {
      joined.push([start, end]);
    }
  }
  return joined;
}

/** The gaps between joined ranges in a file of `length` bytes. */
export function between(joined, length) {
  const starts = [0, ...joined.map(([, end]) => end)];
  const ends = [...joined.map(([start]) => start), length];
  return starts.map((start, at) => [start, ends[at]]).filter(([start, end]) => start < end);
}

/** Does work for each item, up to `most` at a time. The first failure ends it. */
export async function each(items, most, work) {
  let next = 0;
  let failed = false;
  const run = async () => {
    while (next < items.length && !failed) {
      const item = items[next];
      next += 1;
      try {
        await work(item);
      } catch (error) {
        failed = true;
        throw error;
      }
    }
  };
  await Promise.all(Array.from({ length: Math.min(most, items.length) }, run));
}
