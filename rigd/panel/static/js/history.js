// The past of a stream: the newest data in full, older data coarser, for hours.

const SIZE = 1 << 14; // points of a level
const FACTOR = 8; // points of a level that are merged into a point of the next
const USUAL = 15; // points that tell how often points come
const LEVELS = 4; // at 80 points/s: 3 min, 27 min, 3.6 h, 29 h

/** One level: a ring of times with the lowest and highest of each channel. */
class Level {
  /** @param {number} channels */
  constructor(channels) {
    this.t = new Float64Array(SIZE);
    this.low = Array.from({ length: channels }, () => new Float32Array(SIZE));
    this.high = Array.from({ length: channels }, () => new Float32Array(SIZE));
    this.count = 0; // points since the start
  }

  get first() {
    return Math.max(0, this.count - SIZE);
  }

  /** @param {number} index */
  time(index) {
    return this.t[index & (SIZE - 1)];
  }

  /**
   * The first point at or after `t`.
   * @param {number} t
   */
  find(t) {
    let below = this.first;
    let above = this.count;
    while (below < above) {
      const middle = (below + above) >> 1;
      if (this.time(middle) < t) below = middle + 1;
      else above = middle;
    }
    return below;
  }
}

export class History {
  /**
   * @param {number} channels
   * @param {number} levels
   */
  constructor(channels, levels = LEVELS) {
    this.channels = channels;
    this.levels = Array.from({ length: levels }, () => new Level(channels));
    this.newest = -Infinity;
  }

  clear() {
    for (const level of this.levels) level.count = 0;
    this.newest = -Infinity;
  }

  /** The time of the oldest point in full, NaN if there is none. */
  get oldest() {
    const [level] = this.levels;
    return level.count === 0 ? NaN : level.time(level.first);
  }

  /**
   * The number of points before `t`.
   * @param {number} t
   */
  find(t) {
    return this.levels[0].find(t);
  }

  /**
   * Add a frame: points at or before the newest point are left out.
   * @param {import("./frame.js").LiveFrame} frame
   */
  append({ t0, times, low, high }) {
    if (low.length !== this.channels) return;
    if (times.length && t0 + times[times.length - 1] < this.newest - 5) this.clear(); // clock set back
    for (let point = 0; point < times.length; point++) {
      const t = t0 + times[point];
      if (t <= this.newest) continue;
      this.newest = t;
      const level = this.levels[0];
      const place = level.count & (SIZE - 1);
      level.t[place] = t;
      for (let channel = 0; channel < this.channels; channel++) {
        level.low[channel][place] = low[channel][point];
        level.high[channel][place] = high[channel][point];
      }
      level.count += 1;
      this.#condense(0);
    }
  }

  /** @param {number} index */
  #condense(index) {
    const from = this.levels[index];
    const to = this.levels[index + 1];
    if (to === undefined || from.count % FACTOR !== 0) return;
    const place = to.count & (SIZE - 1);
    const start = from.count - FACTOR;
    to.t[place] = from.time(start);
    for (let channel = 0; channel < this.channels; channel++) {
      let low = Infinity;
      let high = -Infinity;
      for (let offset = 0; offset < FACTOR; offset++) {
        const at = (start + offset) & (SIZE - 1);
        // Written so that NaN, which means no measurement, is skipped.
        if (from.low[channel][at] < low) low = from.low[channel][at];
        if (from.high[channel][at] > high) high = from.high[channel][at];
      }
      to.low[channel][place] = low === Infinity ? NaN : low;
      to.high[channel][place] = high === -Infinity ? NaN : high;
    }
    to.count += 1;
    this.#condense(index + 1);
  }

  /**
   * The newest value of a channel: the middle between the extremes of its last point.
   * @param {number} channel
   */
  value(channel) {
    const level = this.levels[0];
    if (level.count === 0) return NaN;
    const at = (level.count - 1) & (SIZE - 1);
    return (level.low[channel][at] + level.high[channel][at]) / 2;
  }

  /**
   * The value of a channel at `t`: of the first point at or after `t`, or the newest value.
   * @param {number} channel
   * @param {number} t
   */
  at(channel, t) {
    const level = this.levels.find((item) => item.count > 0 && item.time(item.first) <= t) ?? this.levels[0];
    const index = Math.min(level.find(t), level.count - 1);
    if (index < level.first || level.count === 0) return NaN;
    const place = index & (SIZE - 1);
    return (level.low[channel][place] + level.high[channel][place]) / 2;
  }

  /**
   * The newest point at or before `t` in which all of `channels` have values, as [time, ...highest]; null if
   * there is none. The middle of an angle that wraps would be none of its values.
   * @param {number[]} channels
   * @param {number} t
   * @returns {number[] | null}
   */
  last(channels, t) {
    const level = this.levels.find((item) => item.count > 0 && item.time(item.first) <= t);
    if (level === undefined) return null;
    let index = level.find(t);
    if (index === level.count || level.time(index) > t) index -= 1;
    for (; index >= level.first; index--) {
      const place = index & (SIZE - 1);
      const point = [level.t[place], ...channels.map((channel) => level.high[channel][place])];
      if (!point.some(Number.isNaN)) return point;
    }
    return null;
  }

  /** The usual time between the newest points, in s: half of them are closer. NaN if there are none. */
  interval() {
    const level = this.levels[0];
    const times = Array.from({ length: Math.min(level.count, USUAL) }, (_, back) => level.time(level.count - 1 - back));
    const waits = times.slice(1).map((t, back) => times[back] - t);
    return waits.sort((a, b) => a - b)[waits.length >> 1] ?? NaN;
  }

  /**
   * The points from `start` to `end`, about `most` at most, each as [time, ...middle between the extremes];
   * NaN if a value is missing.
   * @param {number[]} channels
   * @param {number} start
   * @param {number} end
   * @param {number} most
   */
  points(channels, start, end, most) {
    const level = this.#levelFor(start, end, most / 16);
    const stop = level.find(end);
    const found = [];
    for (let index = level.find(start); index < stop; index++) {
      const place = index & (SIZE - 1);
      found.push([level.t[place], ...channels.map((channel) => (level.low[channel][place] + level.high[channel][place]) / 2)]);
    }
    return found;
  }

  /**
   * Put the extremes of `channel` into columns of `step` s from `start` on: `out[2c]` the lowest,
   * `out[2c+1]` the highest of column c, null if there are no points. Returns the extremes of all columns.
   * @param {number} channel
   * @param {number} start
   * @param {number} step
   * @param {number} count
   * @param {(number | null)[]} out
   */
  columns(channel, start, step, count, out) {
    out.fill(null);
    const end = start + step * count;
    const level = this.#levelFor(start, end, count);
    let lowest = Infinity;
    let highest = -Infinity;
    const stop = level.find(end);
    for (let index = level.find(start); index < stop; index++) {
      const place = index & (SIZE - 1);
      const low = level.low[channel][place];
      const high = level.high[channel][place];
      if (!(low <= high)) continue; // NaN
      const column = Math.min(count - 1, Math.floor((level.t[place] - start) / step));
      out[2 * column] = Math.min(out[2 * column] ?? low, low);
      out[2 * column + 1] = Math.max(out[2 * column + 1] ?? high, high);
      if (low < lowest) lowest = low;
      if (high > highest) highest = high;
    }
    return [lowest, highest];
  }

  /**
   * The coarsest level that still has two points per column; a finer level if no level reaches so far.
   * @param {number} start
   * @param {number} end
   * @param {number} count
   */
  #levelFor(start, end, count) {
    let best = this.levels[0];
    for (const level of this.levels) {
      if (level.count === 0) break;
      const reaches = level.time(level.first) <= start || level.first === 0;
      const points = level.find(end) - level.find(start);
      if (best !== level && best.time(best.first) <= start && points < 2 * count) break;
      best = level;
      if (reaches && points < 16 * count) break;
    }
    return best;
  }
}
