// What became of orders, as each robot's bridge has told; what was not confirmed stays until somebody has seen it.

import { clock, count, el, keyed, put, say } from "./dom.js";

const KEEP = 12; // s for which an order is shown that all have confirmed

export class Orders {
  constructor(element) {
    this.list = element;
    this._seen = new Set();
    this._said = 0;
  }

  // Tell something that did not even leave this page.
  note(text, level = "bad") {
    const node = el("div", { class: `outcome ${level}` }, el("p", {}, text), this._close(() => node.remove()));
    this.list.append(node);
    if (level !== "bad") setTimeout(() => node.remove(), KEEP * 1000);
  }

  render(wire) {
    this._host ??= this.list.appendChild(el("div", { class: "told" }));
    const now = wire.now();
    const shown = wire.of("order").filter((order) => !this._seen.has(order.number) && (!isFine(order) || now - order.at < KEEP));
    keyed(this._host, shown, (order) => order.number, (order) => this._make(order), (node, order) => this._update(node, order));
  }

  _make(order) {
    const node = el("div", { class: "outcome" });
    node.title_ = el("b", {});
    node.rows = el("ul", {});
    node.append(node.title_, node.rows, this._close(() => {
      this._seen.add(order.number);
      node.hidden = true;
    }));
    return node;
  }

  _close(act) {
    return el("button", { type: "button", class: "close", "aria-label": "seen", title: "seen", on: { click: act } }, "✕");
  }

  _update(node, order) {
    const all = Object.entries(order.outcomes ?? {});
    const waiting = all.filter(([, [state]]) => state === "waiting").length;
    const failed = all.filter(([, [state]]) => state === "NOT confirmed").length;
    const told = order.problem
      ? `NOT ordered: ${order.problem}`
      : waiting
        ? `${count(waiting, "robot")} to answer`
        : failed
          ? `${failed} of ${all.length} NOT confirmed`
          : `confirmed by ${all.length === 1 ? "it" : `all ${all.length}`}`;
    say(node.title_, `${clock(order.at)}  ${order.order}${order.of ? " all" : ""}: ${told}`);
    put(node, "class", `outcome ${order.problem || failed ? "bad" : waiting ? "calm" : "good"}`);
    keyed(node.rows, all, ([robot]) => robot, () => el("li", {}), (row, [robot, [state, reason]]) => {
      say(row, `${state === "confirmed" ? "✓" : state === "waiting" ? "…" : "✕"} ${robot}: ${order.order} ${state}${reason ? ` (${reason})` : ""}`);
      put(row, "class", state === "confirmed" ? "good" : state === "waiting" ? "calm" : "bad");
    });
  }
}

function isFine(order) {
  const states = Object.values(order.outcomes ?? {}).map(([state]) => state);
  return !order.problem && states.length > 0 && states.every((state) => state === "confirmed");
}
