// Where the page gets what it cannot work out itself: from the server, or from the file that it is.

export class Served {
  served = true;

  async ask(path, { query = {}, ...options } = {}) {
    const asked = new URLSearchParams(Object.entries(query).filter(([, value]) => value !== "" && value != null));
    const answer = await fetch(`api/${path}?${asked}`, options);
    const content = await answer.json().catch(() => ({ error: `The server answered ${answer.status}.` }));
    if (!answer.ok) throw new Error(content.error);
    return content;
  }

  send(path, content, query = {}, method = "POST") {
    const headers = { "content-type": "application/json" };
    return this.ask(path, { method, query, body: JSON.stringify(content), headers });
  }

  state = () => this.ask("state");
  robot = () => this.ask("robot");
  memory = (name) => this.ask("memory", { query: { name } });
  cells = (name, colour, view, n, signal) => this.ask("cells", { query: { name, colour, ...view, n }, signal });
  perform = (dt, angles) => this.send("perform", { dt, angles: angles.map((row) => [...row]) });
  film = (movement) => this.send("film", movement);
  export = (memory, points, format) => this.send("export", { memory, points, format });
  read = (memory, file) => this.ask("read", { method: "POST", body: file, query: { memory, name: file.name } });
  agent = (name, memory, seed) => this.ask("agent", { query: { name, memory, seed } });
  favourites = (key) => this.ask("favourites", { query: { key } });
  keep = (favourite) => this.send("favourites", favourite);
  forget = (favourite) => this.send("favourites", favourite, {}, "DELETE");
}

export class Alone {
  served = false;
  #kept = "creative-nao-favourites";

  constructor(data) {
    this.data = data;
  }

  state = async () => ({ ready: true, first: this.data.page.memory.name, names: [], beside: "" });
  robot = async () => this.data.robot;
  memory = async () => this.data.page;
  cells = async (_, colour, view) => (view ? null : this.data.colours[colour] ?? this.data.page.cells);
  agent = async (name) => this.data.tries[name];
  favourites = async (key) => this.all().filter((favourite) => favourite.memory === key);
  keep = async (favourite) => this.write([...this.all(), favourite]);
  forget = async (favourite) => this.write(this.all().filter((one) => JSON.stringify(one) !== JSON.stringify(favourite)));

  all() {
    try {
      return JSON.parse(localStorage.getItem(this.#kept)) ?? [];
    } catch {
      return []; // a file may have no store
    }
  }

  write(favourites) {
    localStorage.setItem(this.#kept, JSON.stringify(favourites.slice(-200)));
  }
}

export const base64Blob = ({ content, type }) => {
  const raw = Uint8Array.from(atob(content), (c) => c.charCodeAt(0));
  return new Blob([raw], { type: type ?? "application/octet-stream" });
};

export function download(name, blob) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
