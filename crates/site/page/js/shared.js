// Shared work: the copies of the world on a map show the same tiles.

/** Running work, by key. */
export class Shared {
  #running = new Map();

  /**
   * Waits for the work of a key. The first request starts it; it is aborted when no request waits
   * for it any more.
   */
  share(name, signal, start) {
    let work = this.#running.get(name);
    if (!work) {
      const control = new AbortController();
      work = { control, users: 0, done: start(control.signal) };
      const forget = () => this.#running.get(name) === work && this.#running.delete(name);
      work.done.then(forget, forget);
      this.#running.set(name, work);
    }
    work.users += 1;
    return new Promise((resolve, reject) => {
      signal?.addEventListener("abort", () => {
        reject(signal.reason);
        work.users -= 1;
        if (work.users > 0) return;
        if (this.#running.get(name) === work) this.#running.delete(name);
        work.control.abort();
      }, { once: true });
      work.done.then(resolve, reject);
    });
  }
}
