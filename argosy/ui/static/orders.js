// What became of orders, the newest first; what was not confirmed stays until somebody has seen it.

import { count, el, keyed, put, say, span } from "./dom.js";
import { moment } from "./time.js";

const KEEP = 12; // s for which an order is shown that all have confirmed, and a note
const TAKEN = 2; // s after which an order that the server has not taken counts as not known
const ASKED = 20, NOTES = 5; // orders of this page that the server has not taken, and notes, that are kept
const FOLD = 3; // more robots than these, to which the same happened, are one line

export class Orders {
  constructor(element) {
    this.list = element;
    this._seen = new Set();
    this._asked = []; // orders of this page until the server tells of them
    this._notes = [];
    this._number = 0;
    this._host = el("div", { class: "told" });
    element.append(this._host);
  }

  // Tell something that did not even leave this page.
  note(text, level = "bad") {
    this._notes = [{ key: `note ${(this._number += 1)}`, text, level, began: performance.now() }, ...this._notes.filter((one) => one.text !== text)].slice(0, NOTES);
  }

  // An order was given, at `at` of the server's clock: until the server tells of it, nothing is known.
  asked(text, at) {
    const one = { key: `asked ${(this._number += 1)}`, text, at, began: performance.now(), failed: "" };
    this._asked = [one, ...this._asked].slice(0, ASKED);
    return one;
  }

  answered(one, answer) {
    if (answer.lost || answer.ok === false) one.failed = answer.lost ? answer.reason : `NOT ordered: ${answer.reason}`;
  }

  render(wire) {
    const now = wire.now(), here = performance.now();
    const told = wire.of("order");
    const taken = new Set(told.map((order) => order.clicked));
    this._asked = this._asked.filter((one) => !taken.has(one.at) && !this._seen.has(one.key));
    this._notes = this._notes.filter((one) => here - one.began < KEEP * 1000 && !this._seen.has(one.key));
    const shown = [
      ...this._notes.map((one) => ({ key: one.key, kind: one.level, title: one.text })),
      ...this._asked.map((one) => askedShown(one, (here - one.began) / 1000, moment(wire, one.at))),
      ...told.filter((order) => !this._seen.has(`order ${order.number}`) && (order.state !== "confirmed" || now - order.at < KEEP)).sort((one, other) => other.number - one.number).map((order) => orderShown(order, moment(wire, order.at))),
    ];
    keyed(this._host, shown, (one) => one.key, (one) => this._make(one), (node, one) => this._update(node, one));
  }

  _make({ key }) {
    const node = el("div", { class: "outcome" });
    node.title_ = el("b", {});
    node.rows = el("ul", {});
    node.append(node.title_, node.rows, el("button", { type: "button", class: "close", "aria-label": "seen", title: "seen", on: { click: () => {
      this._seen.add(key);
      node.hidden = true;
    } } }, "✕"));
    return node;
  }

  _update(node, { kind, title, groups }) {
    say(node.title_, title);
    put(node, "class", `outcome ${kind}`);
    keyed(node.rows, groups ?? [], (group) => group.key, makeGroup, updateGroup);
  }
}

function askedShown(one, age, time) {
  const title = `${time}  ${one.text}: `;
  if (one.failed) return { key: one.key, kind: "bad", title: title + one.failed };
  if (age < TAKEN) return { key: one.key, kind: "calm", title: `${title}is being ordered …` };
  return { key: one.key, kind: "bad", title: `${title}NOT known whether it was done: argosy ui has not answered for ${span(age)}` };
}

function orderShown(order, time) {
  const all = Object.entries(order.outcomes ?? {});
  const among = (wanted) => all.filter(([, [state]]) => state === wanted).length;
  const failed = among("NOT confirmed"), waiting = among("waiting");
  const told = {
    looking: "looking for robots …",
    waiting: `${count(waiting, "robot")} to answer${failed ? `, ${failed} of ${all.length} NOT confirmed` : ""}`,
    confirmed: `confirmed by ${all.length === 1 ? "it" : `all ${all.length}`}`,
    "NOT confirmed": `${failed} of ${all.length} NOT confirmed`,
    "NOT ordered": `NOT ordered: ${order.problem}`,
  }[order.state];
  const kind = order.state === "NOT ordered" || failed ? "bad" : order.state === "confirmed" ? "good" : "calm";
  return { key: `order ${order.number}`, kind, title: `${time}  ${order.order}${order.of ? " all" : ""}: ${told}`, groups: groupsOf(order.order, all) };
}

const RANK = { "NOT confirmed": 0, waiting: 1, confirmed: 2 };

// Robots one by one, or, where the same happened to many, together; the worst first, and those are named at once.
function groupsOf(order, all) {
  const alike = new Map();
  for (const [robot, [state, reason]] of all) {
    const key = `${state} ${reason}`;
    if (!alike.has(key)) alike.set(key, { state, reason, robots: [] });
    alike.get(key).robots.push(robot);
  }
  const groups = [];
  for (const { state, reason, robots } of alike.values()) {
    const more = reason ? ` (${reason})` : "";
    if (robots.length > FOLD) groups.push({ key: `${state} ${reason}`, state, text: `${robots.length} robots: ${order} ${state}${more}`, names: robots.join(" ") });
    else for (const robot of robots) groups.push({ key: `robot ${robot}`, state, text: `${robot}: ${order} ${state}${more}` });
  }
  return groups.sort((one, other) => RANK[one.state] - RANK[other.state]);
}

function makeGroup(group) {
  const row = el("li", {});
  row.told = group.names === undefined ? row : el("summary", {});
  if (group.names !== undefined) row.append(el("details", { open: group.state === "NOT confirmed" }, row.told, (row.names = el("p", {}))));
  return row;
}

function updateGroup(row, { state, text, names }) {
  say(row.told, `${state === "confirmed" ? "✓" : state === "waiting" ? "…" : "✕"} ${text}`);
  put(row, "class", state === "confirmed" ? "good" : state === "waiting" ? "calm" : "bad");
  if (names !== undefined) say(row.names, names);
}
