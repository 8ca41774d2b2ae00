// The one WebSocket to `argosy ui`, and what it has told: parts by key, and events. It comes back by itself.

const SILENCE = 3000; // ms without a word, of which there is one a second, after which the server counts as gone
const HERE = 2000; // ms that the server has to say that it is there
const ANSWER = 25000; // ms that it has to answer what was posted: robots have 15 s
const AGAIN = 1000; // ms between two attempts
const EVENTS = 5000; // kept here, as at the server

export class Wire {
  constructor(changed) {
    this.parts = new Map(); // "agent/scout" -> its struct (argosy/ui/view_structs.py)
    this.events = [];
    this.tracks = new Map(); // robots may be called as anything, even `constructor`
    this.leftOut = 0;
    this.problem = "connecting";
    this.lastWord = 0; // performance.now() of the last message
    this._lastDate = 0; // and Date.now(): the other one stands while this machine sleeps
    this._lastNow = 0; // and the server's clock in it
    this._changed = changed;
    this._look = [];
    this._offset = 0; // server's clock minus ours, s
    this._newest = 0;
    this._connect();
    setInterval(() => this._watch(), 500);
  }

  // The server's clock as it was last told, and what went by since: an order says by it when it was given.
  stamp() {
    return this.lastWord ? this._lastNow + (performance.now() - this.lastWord) / 1000 : 0;
  }

  // Unix seconds by the server's clock.
  now() {
    return Date.now() / 1000 + this._offset;
  }

  // Show these agents' minds.
  look(agents) {
    if (agents.join() === this._look.join()) return;
    this._look = agents;
    if (this._socket?.readyState === WebSocket.OPEN) this._tellLook();
  }

  get silentFor() {
    return this.lastWord ? Math.max(performance.now() - this.lastWord, Date.now() - this._lastDate) / 1000 : 0;
  }

  // All parts of one kind, by name: of("agent")
  of(kind) {
    const found = [];
    for (const [key, part] of this.parts) if (key.startsWith(`${kind}/`)) found.push(part);
    return found;
  }

  get(key) {
    return this.parts.get(key) ?? null;
  }

  async post(path, wish) {
    try {
      const answer = await fetch(path, {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify(wish),
        signal: AbortSignal.timeout(ANSWER),
      });
      if (!answer.ok) return { ok: false, reason: (await answer.text()).trim() || `status ${answer.status}` };
      return await answer.json();
    } catch {
      return { ok: false, reason: "the page's server does not answer: NOT known whether it was done", lost: true };
    }
  }

  _connect() {
    const socket = new WebSocket(`ws://${location.host}/feed`);
    this._socket = socket;
    this._began = performance.now();
    let fresh = true; // the first message has everything
    socket.onopen = () => this._tellLook();
    socket.onmessage = (message) => {
      const news = JSON.parse(message.data);
      this._take(news, fresh);
      fresh = false;
    };
    socket.onclose = () => {
      if (this._socket !== socket) return;
      this._socket = null;
      this._gone();
    };
  }

  _tellLook() {
    this._socket.send(JSON.stringify({ look: this._look, event: this._newest }));
  }

  _take(news, fresh) {
    this.lastWord = performance.now();
    this._lastDate = Date.now();
    this._lastNow = news.now;
    this._offset = news.now - Date.now() / 1000;
    this.problem = "";
    const changed = new Set(Object.keys(news.set ?? {}));
    if (fresh) {
      for (const key of this.parts.keys()) if (!changed.has(key)) this.parts.delete(key);
    }
    if (fresh || news.tracks) { // else what was flown since stands in the lines themselves
      this.tracks = new Map(Object.entries(news.tracks ?? {}));
      changed.add("tracks");
    }
    for (const key of news.gone ?? []) {
      this.parts.delete(key);
      changed.add(key);
    }
    for (const [key, part] of Object.entries(news.set ?? {})) this.parts.set(key, part);
    for (const event of news.events ?? []) {
      if (event.number <= this._newest) continue;
      this._newest = event.number;
      this.events.push(event);
      changed.add("events");
    }
    if (this.events.length > EVENTS) this.events.splice(0, this.events.length - EVENTS);
    this.leftOut += news.left_out ?? 0;
    this._changed(changed);
  }

  // Say first that nothing comes any more, then ask why: who hangs does not answer that either.
  async _gone() {
    this.problem ||= "nothing comes from argosy ui any more";
    this._changed(new Set(["problem"]));
    try {
      const answer = await fetch("/here", { cache: "no-store", signal: AbortSignal.timeout(HERE) });
      this.problem = answer.ok
        ? "the connection to argosy ui was cut: connecting again"
        : answer.status === 401
          ? "argosy ui was restarted: open the address that it has printed"
          : `argosy ui refuses this page: ${(await answer.text()).trim()}`;
    } catch {
      this.problem = "argosy ui does not answer: it has ended or hangs, or this machine cannot reach it";
    } finally {
      setTimeout(() => this._connect(), AGAIN);
    }
    this._changed(new Set(["problem"]));
  }

  _watch() {
    if (this.silentFor * 1000 >= SILENCE && !this.problem) {
      this.problem = "nothing comes from argosy ui any more";
      this._changed(new Set(["problem"]));
    }
    const socket = this._socket;
    if (!socket || performance.now() - Math.max(this.lastWord, this._began) < SILENCE) return;
    this._socket = null; // a connection that hangs
    socket.close();
    this._gone();
  }
}
