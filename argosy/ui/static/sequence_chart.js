// Mail between agents as a sequence chart: a lifeline for each agent, an arrow for each message, the newest at the bottom.

import { el, keyed, put, say, shortened, span, svg } from "./dom.js";
import { asOf, missionSeconds, speedOf } from "./time.js";
import { byName, toneOf } from "./tones.js";

const ROW = 26, TOP = 6, LEFT = 62, LIFELINES = 14, ROWS = 100;
const FLIGHT = 2; // s after which a message counts as being on its way for long

export class SequenceChart {
  constructor(element, actions) {
    this._actions = actions;
    this.one = el("input", { type: "checkbox", on: { change: () => this._draw() } });
    this.oneName = el("span", {});
    this.told = el("span", { class: "dim" });
    this.detail = el("div", { class: "detail data", role: "status" });
    this.heads = el("div", { class: "lifelines" });
    this.lives = svg("g", {});
    this.arrows = svg("g", {});
    this.chart = svg("svg", { class: "chart", role: "group", "aria-label": "messages between agents" }, this.lives, this.arrows);
    this.scroll = el("div", { class: "scroll messages", tabindex: "0", "aria-label": "sequence chart" }, this.heads, this.chart);
    this.scroll.addEventListener("scroll", () => (this._bottom = this.scroll.scrollHeight - this.scroll.scrollTop - this.scroll.clientHeight < 30));
    this._bottom = true;
    element.append(
      el("div", { class: "bar sub" }, el("label", { class: "only" }, this.one, "only ", this.oneName), el("span", { class: "legend" }, el("span", { class: "arrow" }, "→ received"), el("span", { class: "arrow flight" }, "⇢ on its way"), el("span", { class: "arrow lost" }, "✕ not delivered")), el("span", { class: "grow" }), this.told),
      this.scroll,
      this.detail,
    );
    new ResizeObserver(() => this._draw()).observe(this.scroll);
  }

  render(wire, changed, selected) {
    const other = selected !== this._selected;
    this._wire = wire;
    this._selected = selected;
    say(this.oneName, selected ?? "the selected agent");
    const flying = this._flying && performance.now() - this._drawn > 1000;
    if (other || flying || [...changed].some((key) => key.startsWith("message/"))) this._draw();
  }

  _draw() {
    const width = this.scroll.clientWidth - 4;
    if (!this._wire || width < 100) return;
    this._drawn = performance.now();
    const now = asOf(this._wire);
    let messages = this._wire.of("message").sort((one, other) => at(one) - at(other) || one.number - other.number);
    const all = messages.length;
    if (this.one.checked && this._selected) messages = messages.filter((one) => [one.sender, one.receiver].includes(this._selected));
    messages = messages.slice(-ROWS);
    const names = [...new Set(messages.flatMap((one) => [one.sender, one.receiver]))].sort(byName);
    const lines = names.slice(0, LIFELINES);
    const inView = messages.filter((one) => lines.includes(one.sender) && lines.includes(one.receiver));
    const left = names.length - lines.length;
    say(this.told, `${inView.length} of ${all} messages${left ? `; ${left} more agents: select one` : ""}`);
    this._flying = inView.some((one) => isFlying(one));
    const gap = (width - LEFT) / Math.max(1, lines.length);
    const x = new Map(lines.map((name, index) => [name, LEFT + gap * (index + 0.5)]));
    keyed(this.heads, lines, (name) => name, (name) => el("button", { type: "button", class: "lifeline data", on: { click: () => this._actions.select(name, null) } }, name), (node, name) => {
      node.style.left = `${x.get(name)}px`;
      node.style.maxWidth = `${gap - 6}px`;
      put(node, "aria-pressed", String(name === this._selected));
    });
    const height = TOP + inView.length * ROW + 10;
    put(this.chart, "width", width);
    put(this.chart, "height", height);
    keyed(this.lives, lines, (name) => name, () => svg("line", { class: "life", y1: 0 }), (life, name) => {
      for (const [end, value] of Object.entries({ x1: x.get(name), x2: x.get(name), y2: height })) put(life, end, value);
    });
    // An arrow is drawn anew when something of it changes; the others stay, with the focus.
    const rows = inView.map((message, index) => ({ message, key: [message.number, x.get(message.sender), x.get(message.receiver), this._state(message, now).join()].join(), index }));
    keyed(this.arrows, rows, (row) => row.key, ({ message }) => this._arrow(message, x, gap, now), (group, { index }) => put(group, "transform", `translate(0 ${TOP + (index + 0.7) * ROW})`));
    if (inView.length === 0) say(this.detail, all ? "" : "no message between agents yet");
    if (this._bottom) this.scroll.scrollTop = this.scroll.scrollHeight;
  }

  // How a message is, and what is to be said of it besides its content.
  _state(message, now) {
    if (isLost(message)) return ["lost", `  ${message.undelivered}`];
    if (isFlying(message)) {
      const age = message.sent ? now - message.sent : 0;
      return ["flight", age > FLIGHT ? `  on its way for ${span(age * speedOf(this._wire))}` : ""];
    }
    const late = message.sent && message.received ? message.received - message.sent : 0;
    return ["arrow", late > FLIGHT ? `  took ${span(late * speedOf(this._wire))}` : ""];
  }

  _arrow(message, x, gap, now) {
    const from = x.get(message.sender), to = x.get(message.receiver);
    const [state, more] = this._state(message, now);
    const direction = to > from ? 1 : -1;
    const self = from === to;
    const end = self ? from + 24 : isLost(message) ? from + (to - from) * 0.62 : to;
    const told = `${message.performative} ${message.content}`;
    const room = Math.max(8, Math.floor(((self ? gap : Math.abs(to - from)) - 16) / 5.9));
    const time = this._time(message.sent ?? message.received);
    const tip = isLost(message) ? `M${end - 5} -5L${end + 5} 5M${end - 5} 5L${end + 5} -5` : `M${end - 7 * direction} -4L${end} 0L${end - 7 * direction} 4`;
    const group = svg("g", { class: `message ${state}`, tabindex: "0", role: "button", "data-id": message.id, style: { "--tone": toneOf(this._wire.get(`agent/${message.sender}`)?.robot || message.sender) } },
      svg("title", {}, `${message.sender} → ${message.receiver}: ${told}${more}`),
      svg("rect", { class: "hit", x: 0, y: -ROW * 0.7, width: "100%", height: ROW }),
      svg("text", { class: "time", x: 4, y: 3 }, time),
      svg("line", { x1: from, x2: end, y1: 0, y2: 0 }),
      svg("path", { class: "end", d: tip }),
      svg("text", { class: "content", x: self ? from + 28 : (from + to) / 2, y: -5, "text-anchor": self ? "start" : "middle" }, shortened(told + more, room)),
    );
    const show = () => this._show(message, told, more, time);
    group.addEventListener("click", show);
    group.addEventListener("focus", show);
    return group;
  }

  _show(message, told, more, time) {
    const reply = message.in_reply_to ? `  (in reply to ${message.in_reply_to})` : "";
    say(this.detail, `${time}  ${message.sender} → ${message.receiver}  ${told}${more}${reply}`);
  }

  _time(at) {
    return missionSeconds(this._wire, at)?.toFixed(1) ?? "";
  }
}

function isFlying(message) {
  return message.received === null && !message.undelivered;
}

function isLost(message) {
  return message.received === null && Boolean(message.undelivered);
}

function at(message) {
  return message.sent ?? message.received ?? 0;
}
