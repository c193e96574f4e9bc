// The web worker that encodes scans and runs the networks, so that the page stays responsive.

import * as ort from "./ort.mjs";
import { createEncoding } from "./encodings.js";

let networks = [];

const handlers = {
  /** Unpack the runtime and the networks; both come as base64 of gzip. */
  async load({ wasm, weights, descriptions }) {
    ort.env.wasm.numThreads = 1;
    ort.env.wasm.wasmBinary = await unpack(wasm);
    networks = descriptions.map((description, i) => ({
      grid: description.grid, encoding: createEncoding(description.encoding), weights: weights[i], session: null,
    }));
    await sessionOf(networks[0]);
    return {};
  },

  /** Predict the map at the last step of a window. */
  async predict({ network, scans }) {
    const { grid, encoding } = networks[network], session = await sessionOf(networks[network]);
    const begin = performance.now(), images = encoding.draw(scans, grid);
    const shape = [1, images.length / grid.size_px ** 2, grid.size_px, grid.size_px];
    const feeds = { [session.inputNames[0]]: new ort.Tensor("float32", encoding.toInput(images), shape) };
    const { data } = (await session.run(feeds))[session.outputNames[0]];
    const free = Float32Array.from(data, (logit) => 1 / (1 + Math.exp(-logit)));
    return { images, free, ms: performance.now() - begin };
  },
};

self.addEventListener("message", async ({ data: { id, task, ...values } }) => {
  try {
    const result = await handlers[task](values);
    const buffers = [result.images?.buffer, result.free?.buffer].filter(Boolean);
    self.postMessage({ id, result }, buffers);
  } catch (error) {
    self.postMessage({ id, error: String(error?.message ?? error) });
  }
});

self.postMessage("loaded");

/** Return the session of a network, created at its first use. */
async function sessionOf(network) {
  network.session ??= unpack(network.weights).then((bytes) => {
    network.weights = null;
    return ort.InferenceSession.create(bytes, { executionProviders: ["wasm"], graphOptimizationLevel: "all" });
  });
  return network.session;
}

/** Decode base64 and decompress gzip. */
async function unpack(base64) {
  const text = atob(base64), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}
