// Turns the modules of the page, in the order of their dependencies, into URLs that import each other, and starts main.js.
// A page that is opened from disk and its worker cannot load each other's URLs: the worker links the modules itself.
function link(modules) {
  const urls = {};
  for (const [name, source] of Object.entries(modules)) {
    const linked = source.replace(/from "\.\/([\w.]+)"/g, (_, imported) => `from "${urls[imported]}"`);
    urls[name] = URL.createObjectURL(new Blob([linked], { type: "text/javascript" }));
  }
  return urls;
}

const modules = JSON.parse(document.getElementById("modules").textContent);
const script = `${link}
self.addEventListener("message", ({ data }) => import(link(data)["inference_worker.js"]).catch((error) => {
  setTimeout(() => { throw error; }); // as an error event of the worker
}), { once: true });`;
const worker = new Worker(URL.createObjectURL(new Blob([script], { type: "text/javascript" })));
const { start } = await import(link(modules)["main.js"]);
await start(worker, modules);
