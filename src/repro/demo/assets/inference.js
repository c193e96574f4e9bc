// The page's side of the inference worker: requests and their answers, in order.

/**
 * Start a worker and return a function that sends it a task with values and resolves to its result.
 *
 * @param {Worker} worker see loader.js
 * @param {object} modules sources by name, which the worker links; it then runs inference_worker.js
 */
export async function connect(worker, modules) {
  const waiting = new Map();
  let last = 0;
  await new Promise((resolve, reject) => {
    worker.addEventListener("message", resolve, { once: true });
    worker.addEventListener("error", (event) => reject(new Error(event.message || "its worker does not start")), { once: true });
    worker.postMessage(modules);
  });
  worker.addEventListener("message", ({ data: { id, result, error } }) => {
    const { resolve, reject } = waiting.get(id);
    waiting.delete(id);
    if (error === undefined) resolve(result); else reject(new Error(error));
  });
  return (task, values) => new Promise((resolve, reject) => {
    waiting.set(++last, { resolve, reject });
    worker.postMessage({ id: last, task, ...values });
  });
}
