// Measures the height of the state and the stops, so that no dialog or scrolled content is hidden below them.

/** @param {HTMLElement} head */
export function measureHead(head) {
  const measure = () => document.documentElement.style.setProperty("--head", `${Math.ceil(head.offsetHeight)}px`);
  new ResizeObserver(measure).observe(head);
  measure();
}
