// Ranges of bytes: joined where they are near each other.

/** Bytes between two ranges up to which these are fetched as one. */
const GAP = 32 * 1024;
/** Bytes that are fetched with one request, unless a single range has more. */
const MAX_JOINED = 8 * 2 ** 20;

/** Joins ranges that are near each other, to no more than so many bytes. */
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

/** The ranges of so many bytes that lie between joined ones. */
export function between(joined, length) {
  const starts = [0, ...joined.map(([, end]) => end)];
  const ends = [...joined.map(([start]) => start), length];
  return starts.map((start, at) => [start, ends[at]]).filter(([start, end]) => start < end);
}

/** Does work for each item, so many at a time. The first failure ends it. */
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
