// Runs in a worker, requested by the page.

export class Runner {
  constructor(source, catalogue, modules) {
    const address = URL.createObjectURL(new Blob([source], {type: "text/javascript"}));
    this.worker = new Worker(address);
    this.waiting = new Map();
    this.count = 0;
    this.worker.onmessage = ({data}) => this.#settle(data.id, data);
    this.worker.onerror = (event) => [...this.waiting.keys()].forEach((id) => this.#settle(id, {error: event.message}));
    this.worker.postMessage({catalogue, modules});
  }

  // rows: "all", "none" or {names, count} for thinned columns.
  run(request, rows = "all") {
    const id = ++this.count;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, {resolve, reject});
      this.worker.postMessage({id, request, rows});
    });
  }

  #settle(id, {result, error}) {
    const {resolve, reject} = this.waiting.get(id) ?? {};
    this.waiting.delete(id);
    if (error) reject?.(new Error(error));
    else resolve?.(result);
  }
}

// For requests that come faster than the work is done: only the latest waiting one is kept.
export function latest(work) {
  let busy = false, next = null;
  return async function ask(request) {
    next = {request};
    if (busy) return;
    busy = true;
    while (next) {
      const {request: current} = next;
      next = null;
      await work(current, () => next !== null);
    }
    busy = false;
  };
}
