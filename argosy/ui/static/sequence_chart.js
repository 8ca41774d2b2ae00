// Mail between agents as a sequence chart: a lifeline for each agent, an arrow for each message, the newest at the bottom.

import { el, keyed, put, say, shortened, span, svg } from "./dom.js";
import { asOf, missionSeconds, speedOf } from "./time.js";
import { byName, toneOf } from "./tones.js";

const ROW = 26, TOP = 6, LEFT = 62, LIFELINES = 14, ROWS = 100;
const FLIGHT = 2; // s after which a message counts as being on its way for long

export class Letters {
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
    this.scroll = el("div", { class: "scroll letters", tabindex: "0", "aria-label": "sequence chart" }, this.heads, this.chart);
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
    if (other || flying || [...changed].some((key) => key.startsWith("letter/"))) this._draw();
  }

  _draw() {
    const width = this.scroll.clientWidth - 4;
    if (!this._wire || width < 100) return;
    this._drawn = performance.now();
    const now = asOf(this._wire);
    let letters = this._wire.of("letter").sort((one, other) => at(one) - at(other) || one.number - other.number);
    const all = letters.length;
    if (this.one.checked && this._selected) letters = letters.filter((one) => [one.sender, one.receiver].includes(this._selected));
    letters = letters.slice(-ROWS);
    const names = [...new Set(letters.flatMap((one) => [one.sender, one.receiver]))].sort(byName);
    const lines = names.slice(0, LIFELINES);
    const inView = letters.filter((one) => lines.includes(one.sender) && lines.includes(one.receiver));
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
    const rows = inView.map((letter, index) => ({ letter, key: [letter.number, x.get(letter.sender), x.get(letter.receiver), this._state(letter, now).join()].join(), index }));
    keyed(this.arrows, rows, (row) => row.key, ({ letter }) => this._arrow(letter, x, gap, now), (group, { index }) => put(group, "transform", `translate(0 ${TOP + (index + 0.7) * ROW})`));
    if (inView.length === 0) say(this.detail, all ? "" : "no message between agents yet");
    if (this._bottom) this.scroll.scrollTop = this.scroll.scrollHeight;
  }

  // How a message is, and what is to be said of it besides its content.
  _state(letter, now) {
    if (isLost(letter)) return ["lost", `  ${letter.undelivered}`];
    if (isFlying(letter)) {
      const age = letter.sent ? now - letter.sent : 0;
      return ["flight", age > FLIGHT ? `  on its way for ${span(age * speedOf(this._wire))}` : ""];
    }
    const late = letter.sent && letter.received ? letter.received - letter.sent : 0;
    return ["arrow", late > FLIGHT ? `  took ${span(late * speedOf(this._wire))}` : ""];
  }

  _arrow(letter, x, gap, now) {
    const from = x.get(letter.sender), to = x.get(letter.receiver);
    const [state, more] = this._state(letter, now);
    const direction = to > from ? 1 : -1;
    const self = from === to;
    const end = self ? from + 24 : isLost(letter) ? from + (to - from) * 0.62 : to;
    const told = `${letter.performative} ${letter.content}`;
    const room = Math.max(8, Math.floor(((self ? gap : Math.abs(to - from)) - 16) / 5.9));
    const time = this._time(letter.sent ?? letter.received);
    const tip = isLost(letter) ? `M${end - 5} -5L${end + 5} 5M${end - 5} 5L${end + 5} -5` : `M${end - 7 * direction} -4L${end} 0L${end - 7 * direction} 4`;
    const group = svg("g", { class: `letter ${state}`, tabindex: "0", role: "button", "data-id": letter.id, style: { "--tone": toneOf(this._wire.get(`agent/${letter.sender}`)?.robot || letter.sender) } },
      svg("title", {}, `${letter.sender} → ${letter.receiver}: ${told}${more}`),
      svg("rect", { class: "hit", x: 0, y: -ROW * 0.7, width: "100%", height: ROW }),
      svg("text", { class: "time", x: 4, y: 3 }, time),
      svg("line", { x1: from, x2: end, y1: 0, y2: 0 }),
      svg("path", { class: "end", d: tip }),
      svg("text", { class: "content", x: self ? from + 28 : (from + to) / 2, y: -5, "text-anchor": self ? "start" : "middle" }, shortened(told + more, room)),
    );
    const show = () => this._show(letter, told, more, time);
    group.addEventListener("click", show);
    group.addEventListener("focus", show);
    return group;
  }

  _show(letter, told, more, time) {
    const reply = letter.in_reply_to ? `  (in reply to ${letter.in_reply_to})` : "";
    say(this.detail, `${time}  ${letter.sender} → ${letter.receiver}  ${told}${more}${reply}`);
  }

  _time(at) {
    return missionSeconds(this._wire, at)?.toFixed(1) ?? "";
  }
}

function isFlying(letter) {
  return letter.state === "in_flight";
}

function isLost(letter) {
  return letter.state === "undelivered";
}

function at(letter) {
  return letter.sent ?? letter.received ?? 0;
}
