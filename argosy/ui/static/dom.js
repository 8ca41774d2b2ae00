// The page is made of elements and text nodes only: whatever comes from the wire is text, and stays text.

const SVG = "http://www.w3.org/2000/svg";

// el("button", {class: "x", title: t, on: {click: f}, style: {"--tone": c}}, "text", child, null)
export function el(tag, attributes, ...children) {
  return fill(document.createElement(tag), attributes, children);
}

export function svg(tag, attributes, ...children) {
  return fill(document.createElementNS(SVG, tag), attributes, children);
}

function fill(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes ?? {})) {
    if (value === null || value === undefined || value === false) continue;
    if (name === "on") for (const [event, act] of Object.entries(value)) node.addEventListener(event, act);
    else if (name === "style") for (const [property, one] of Object.entries(value)) node.style.setProperty(property, one);
    else node.setAttribute(name, value === true ? "" : String(value));
  }
  node.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return node;
}

// Set a text without touching what shows it already.
export function say(node, text) {
  text = String(text ?? "");
  if (node.textContent !== text) node.textContent = text;
  return node;
}

export function put(node, name, value) {
  if (value === null || value === undefined || value === false) {
    if (node.hasAttribute(name)) node.removeAttribute(name);
  } else {
    const text = value === true ? "" : String(value);
    if (node.getAttribute(name) !== text) node.setAttribute(name, text);
  }
}

const known = new WeakMap();

// Let `parent` have one child for each item, in their order. Children stay who they are, with focus and scroll position.
export function keyed(parent, items, keyOf, make, update) {
  const before = known.get(parent) ?? new Map();
  const now = new Map();
  let next = parent.firstChild;
  for (const item of items) {
    const key = keyOf(item);
    if (now.has(key)) continue;
    const child = before.get(key) ?? make(item);
    now.set(key, child);
    if (child === next) next = next.nextSibling;
    else parent.insertBefore(child, next);
    update?.(child, item);
  }
  for (const [key, child] of before) if (!now.has(key)) child.remove();
  known.set(parent, now);
}

// "4 s", "12 s", "3 min", "2 h"
export function span(seconds) {
  if (seconds < 90) return `${Math.max(0, Math.floor(seconds))} s`;
  if (seconds < 5400) return `${Math.floor(seconds / 60)} min`;
  return `${Math.floor(seconds / 3600)} h`;
}

export function clock(at) {
  return new Date(at * 1000).toTimeString().slice(0, 8);
}

export function shortened(text, most) {
  return text.length <= most ? text : `${text.slice(0, most - 1)}…`;
}

export function count(number, one, many = `${one}s`) {
  return `${number} ${number === 1 ? one : many}`;
}
