// Elements without templates. Text is only set as text, so that no text of the rig becomes markup.

const NO_TEXT = /[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]/g;
const SHOWN = new Set(["textContent", "title", "placeholder"]);

/**
 * A text in which invisible characters, and characters that change the direction, are replaced by escapes.
 * @param {string} text
 */
export function visible(text) {
  return text.replace(NO_TEXT, (letter) => `\\u${letter.charCodeAt(0).toString(16).padStart(4, "0")}`);
}

/**
 * @param {readonly Child[]} children
 * @returns {(Node | string)[]}
 */
function parts(children) {
  return children.flatMap((child) => {
    if (child === null || child === undefined) return [];
    if (child instanceof Node) return [child];
    return typeof child === "object" ? parts(child) : [visible(String(child))];
  });
}

/**
 * Make an element. `props` are properties, except `class`, `data`, `aria-*`, `role` and other names
 * with a dash, which are attributes; `onclick` and similar are listeners. null children are left out.
 * @template {keyof HTMLElementTagNameMap} T
 * @param {T} tag
 * @param {Props} props
 * @param {...Child} children
 * @returns {HTMLElementTagNameMap[T]}
 */
export function el(tag, props = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(props)) {
    if (value === null || value === undefined) continue;
    if (name === "class") made.className = String(value);
    else if (name === "data") Object.assign(made.dataset, value);
    else if (name.startsWith("on")) made.addEventListener(name.slice(2), /** @type {EventListener} */ (value));
    else if (name.includes("-") || name === "role" || name === "for") made.setAttribute(name, visible(String(value)));
    else Object.assign(made, { [name]: SHOWN.has(name) ? visible(String(value)) : value });
  }
  made.append(...parts(children));
  return made;
}

/**
 * The name of a file, which may break behind its parts.
 * @param {string} name
 */
export function file(name) {
  return el("code", {}, name.split(/(?<=_)/).flatMap((part) => [part, el("wbr")]));
}

/**
 * Replace what stands in `parent`.
 * @param {Element} parent
 * @param {...Child} children
 */
export function fill(parent, ...children) {
  parent.replaceChildren(...parts(children));
}

/**
 * Set the text of an element, touching the page only if it differs.
 * @param {Element} element
 * @param {string} text
 */
export function setText(element, text) {
  const shown = visible(text);
  if (element.textContent === shown) return;
  const only = element.firstChild === element.lastChild ? element.firstChild : null;
  // To set the text of the element would make a new node each time: hundreds each second, which stay in memory
  // until the browser looks for them.
  if (only instanceof Text && shown !== "") only.data = shown;
  else element.textContent = shown;
}

/**
 * Set or remove an attribute that is either there or not, touching the page only if it differs.
 * @param {Element} element
 * @param {string} name
 * @param {boolean} on
 */
export function flag(element, name, on) {
  if (element.hasAttribute(name) !== on) element.toggleAttribute(name, on);
}

/**
 * Set a data attribute, touching the page only if it differs.
 * @param {HTMLElement} element
 * @param {string} name
 * @param {string | boolean} value
 */
export function mark(element, name, value) {
  if (element.dataset[name] !== String(value)) element.dataset[name] = String(value);
}

/**
 * Show the beginning of what a press has opened, if it stands above or below the visible part.
 * @param {Element} sheet
 */
export function reveal(sheet) {
  const { top } = sheet.getBoundingClientRect();
  const head = parseFloat(getComputedStyle(document.documentElement).scrollPaddingTop) || 0;
  if (top < head || top > innerHeight / 2) sheet.scrollIntoView({ block: "start" });
}

/**
 * The element of the page with this id.
 * @param {string} id
 */
export function byId(id) {
  const found = document.getElementById(id);
  if (found === null) throw new Error(`the page has no #${id}`);
  return found;
}

const SVG = "http://www.w3.org/2000/svg";
const PATHS = {
  pause: "M8 5v14M16 5v14",
  play: "M7 4.5v15l12-7.5z",
  check: "M4 12.5l5 5L20 6.5",
  warn: "M12 4 2.5 20h19zM12 10v5M12 17.6v.4",
  hand: "M12 3v9M8 6v8M16 5v8M5 10v4c0 4 3 7 7 7s7-3 7-7V8",
  lock: "M6 11h12v9H6zM8.5 11V8a3.5 3.5 0 0 1 7 0v3",
  user: "M12 12a4 4 0 1 0 0-8 4 4 0 0 0 0 8M4 21c0-4 3.5-6 8-6s8 2 8 6",
  sun: "M12 8a4 4 0 1 0 0 8 4 4 0 0 0 0-8M12 2v2M12 20v2M2 12h2M20 12h2M5 5l1.4 1.4M17.6 17.6 19 19M5 19l1.4-1.4M17.6 6.4 19 5",
  down: "M12 4v11M7 11l5 5 5-5M5 20h14",
  question: "M9 9a3 3 0 1 1 4.2 2.7c-.8.4-1.2 1-1.2 2.3M12 17.6v.4",
  sound: "M4 9.5v5h3.5L12 19V5L7.5 9.5zM15.5 9a4.5 4.5 0 0 1 0 6M18 6.5a8 8 0 0 1 0 11",
  cut: "M2.5 12h6M15.5 12h6M9.5 17 14.5 7",
};

/**
 * A small drawing beside a word; never the only sign of something.
 * @param {keyof typeof PATHS} name
 */
export function icon(name) {
  const made = document.createElementNS(SVG, "svg");
  made.setAttribute("viewBox", "0 0 24 24");
  made.setAttribute("class", "icon");
  made.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(SVG, "path");
  path.setAttribute("d", PATHS[name]);
  made.append(path);
  return made;
}
