// How high the state and the stops are: nothing that is scrolled to, and no dialog, goes under them.

export function measureHead(head) {
  const tell = () => document.documentElement.style.setProperty("--head", `${Math.ceil(head.offsetHeight)}px`);
  new ResizeObserver(tell).observe(head);
  tell();
}
