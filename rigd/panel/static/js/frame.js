// Live frames: see docs/protocol.md. Little endian, like the typed arrays of every present browser.

const HEAD = 24;

/** @typedef {{ stream: number, t0: number, times: Float64Array, low: Float32Array[], high: Float32Array[] }} LiveFrame */

/**
 * Return the frames in `buffer`, which follow one another.
 * @param {ArrayBuffer} buffer
 */
export function decode(buffer) {
  const view = new DataView(buffer);
  /** @type {LiveFrame[]} */
  const frames = [];
  let at = 0;
  while (at + HEAD <= buffer.byteLength) {
    if (view.getUint32(at) !== 0x52474631) throw new Error("not a live frame"); // "RGF1"
    const stream = view.getUint16(at + 4, true);
    const channels = view.getUint16(at + 6, true);
    const points = view.getUint32(at + 8, true);
    const t0 = Number(view.getBigUint64(at + 16, true)) / 1e9;
    const times = doubles(buffer, at + HEAD, points);
    const low = [];
    const high = [];
    let place = at + HEAD + 8 * points;
    for (let channel = 0; channel < channels; channel++) {
      low.push(floats(buffer, place, points));
      high.push(floats(buffer, place + 4 * points, points));
      place += 8 * points;
    }
    frames.push({ stream, t0, times, low, high });
    at = place;
  }
  return frames;
}

// The size of a frame is a multiple of 8 bytes: typed arrays must be aligned.
/** @type {(buffer: ArrayBuffer, at: number, count: number) => Float64Array} */
const doubles = (buffer, at, count) => new Float64Array(buffer, at, count);
/** @type {(buffer: ArrayBuffer, at: number, count: number) => Float32Array} */
const floats = (buffer, at, count) => new Float32Array(buffer, at, count);
