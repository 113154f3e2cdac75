// Moving and zooming by mouse, wheel, touch pad and fingers.

const WHEEL = 0.0015; // zoom by pixel of the wheel

/**
 * @typedef {object} Actions
 * @property {() => number} now
 * @property {(seconds: number) => void} pan
 * @property {(factor: number, anchor: number | null) => void} zoom
 * @property {() => void} live
 */

/**
 * Move and zoom the plot below `over`.
 * @param {HTMLElement} over
 * @param {Actions} actions
 * @param {() => [number, number]} range the stretch of time shown
 */
export function panAndZoom(over, actions, range) {
  /** @type {Map<number, number>} */
  const pointers = new Map();
  /** @param {number} x */
  const timeAt = (x) => {
    const [start, end] = range();
    const box = over.getBoundingClientRect();
    return start + ((x - box.left) / box.width) * (end - start);
  };
  const perPixel = () => (range()[1] - range()[0]) / over.clientWidth;

  over.addEventListener("pointerdown", (event) => {
    if (event.pointerType === "mouse" && event.button !== 0) return;
    over.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, event.clientX);
  });
  over.addEventListener("pointermove", (event) => {
    if (!pointers.has(event.pointerId)) return;
    const before = [...pointers.values()];
    pointers.set(event.pointerId, event.clientX);
    const after = [...pointers.values()];
    if (after.length === 1) {
      actions.pan((before[0] - after[0]) * perPixel());
    } else if (after.length === 2) {
      const wide = Math.max(20, Math.abs(after[0] - after[1]));
      actions.zoom(Math.max(20, Math.abs(before[0] - before[1])) / wide, timeAt((after[0] + after[1]) / 2));
    }
  });
  /** @param {PointerEvent} event */
  const end = (event) => pointers.delete(event.pointerId);
  over.addEventListener("pointerup", end);
  over.addEventListener("pointercancel", end);
  over.addEventListener("lostpointercapture", end);
  over.addEventListener("wheel", (event) => {
    event.preventDefault();
    if (Math.abs(event.deltaX) > Math.abs(event.deltaY) || event.shiftKey) {
      actions.pan((event.deltaX || event.deltaY) * perPixel());
    } else {
      actions.zoom(Math.exp(event.deltaY * WHEEL), timeAt(event.clientX));
    }
  }, { passive: false });
  over.addEventListener("dblclick", () => actions.live());
}
