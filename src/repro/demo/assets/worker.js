// The web worker that encodes scans and runs the networks, so that the page stays responsive.

import { createEncoding } from "./encodings.js";

let ort = null, networks = [];

self.addEventListener("message", async ({ data }) => {
  try {
    self.postMessage(await (data.networks ? load(data) : predict(data)));
  } catch (error) {
    self.postMessage({ error: String(error?.message ?? error) });
  }
});

/** Load the runtime, a module of JavaScript and base64 of gzip, and keep the networks. */
async function load(settings) {
  ort = await import(URL.createObjectURL(new Blob([settings.runtime], { type: "text/javascript" })));
  ort.env.wasm.numThreads = 1;
  ort.env.wasm.wasmBinary = await unpack(settings.wasm);
  networks = settings.networks.map((network) => ({ ...network, encoding: createEncoding(network.encoding) }));
  return {};
}

/** Predict the probability of free at the last step of a window, with the network of a number. */
async function predict({ number, scans }) {
  const { grid, encoding, weights } = networks[number], images = encoding.draw(scans, grid);
  networks[number].session ??= await ort.InferenceSession.create(await unpack(weights), { executionProviders: ["wasm"] });
  const { session } = networks[number], shape = [1, images.length / grid.size_px ** 2, grid.size_px, grid.size_px];
  const feeds = { [session.inputNames[0]]: new ort.Tensor("float32", encoding.toInput(images), shape) };
  const { data } = (await session.run(feeds))[session.outputNames[0]];
  return { images, free: Float32Array.from(data, (logit) => 1 / (1 + Math.exp(-logit))) };
}

/** Decode base64 and decompress gzip. */
async function unpack(base64) {
  const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  return new Uint8Array(await new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer());
}
