// The server's annotations over HTTP: a function for each request. It accesses no
// element.

import { signIn } from "/identity.js";
import { Refusal } from "/view.js";

/** Two editors changed the same item: the current version, and the sent one. */
export class Conflict extends Error {
  constructor(problem) {
    super(problem.detail ?? "another user changed this item in the meantime");
    Object.assign(this, { current: problem.current ?? null, yours: problem.yours ?? null });
  }
}

/** A refusal with its kind: the code of the problem, such as `annotations-off`. */
class Problem extends Refusal {
  constructor(status, problem) {
    super(problem.detail ?? `The server answered ${status}.`);
    Object.assign(this, { status, problem, kind: problem.code ?? "" });
  }
}

/** A new id: a random UUID. `crypto.randomUUID` needs a secure context, and this page may be served over plain HTTP. */
export function newId() {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  bytes[6] = (bytes[6] & 0x0f) | 0x40;
  bytes[8] = (bytes[8] & 0x3f) | 0x80;
  const hex = [...bytes].map((byte) => byte.toString(16).padStart(2, "0")).join("");
  return [hex.slice(0, 8), hex.slice(8, 12), hex.slice(12, 16), hex.slice(16, 20), hex.slice(20)].join("-");
}

async function ask(url, options = {}) {
  let answer;
  try {
    answer = await fetch(url, options);
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Refusal("The server does not answer. What was not confirmed is not saved; try again when it is back.", 2000);
  }
  if (answer.ok || answer.status === 304) return answer;
  if (answer.status === 401) signIn();
  const problem = await answer.json().catch(() => ({}));
  // The body decides: nothing-to-undo has this status too.
  if (answer.status === 409 && (problem.current !== undefined || problem.code?.endsWith("conflict"))) throw new Conflict(problem);
  throw new Problem(answer.status, problem);
}

/** The names of the archives that take results. */
export async function archivesForResults() {
  const { archives, take_results: takeResults } = await (await ask("/v1/archives")).json();
  return takeResults ? archives : [];
}

/** Annotations of one volume, as one author. */
export class Annotations {
  constructor(volume, author) {
    this.volume = volume;
    this.author = author;
    this.path = `/v1/volumes/${volume.id}/annotations`;
  }

  #headers(more = {}) {
    return { ...(this.author ? { "Relief-Author": encodeURIComponent(this.author) } : {}), ...more };
  }

  async #send(method, part, body, { type = "application/json", more = {}, signal } = {}) {
    const headers = this.#headers(body === undefined ? more : { "Content-Type": type, ...more });
    const packed = type === "application/json" && body !== undefined ? JSON.stringify(body) : body;
    const answer = await ask(`${this.path}${part}`, { method, headers, body: packed, signal });
    return answer.status === 204 ? null : answer.json();
  }

  /** All sets and items; null if nothing changed since the previous request. */
  async list() {
    const known = this.tag ? { "If-None-Match": this.tag } : {};
    const answer = await ask(this.path, { headers: this.#headers(known), cache: "no-store" });
    if (answer.status === 304) return null;
    const found = await answer.json();
    this.tag = answer.headers.get("ETag");
    return found;
  }

  /** Applies all changes or none; returns the events. */
  async apply(changes, reason = "") {
    return (await this.#send("POST", "", { author: this.author, reason, changes })).events;
  }

  async undo() {
    return (await this.#send("POST", "/undo", {})).events;
  }

  async redo() {
    return (await this.#send("POST", "/redo", {})).events;
  }

  async log(limit = 200, after = 0) {
    const answer = await ask(`${this.path}/log?after=${after}&limit=${limit}`, { headers: this.#headers() });
    return (await answer.json()).events;
  }

  snap(body) {
    return this.#send("POST", "/snap", body);
  }

  grow(body, signal) {
    return this.#send("POST", "/grow", body, { signal });
  }

  paint(body, signal) {
    return this.#send("POST", "/paint", body, { signal });
  }

  refine(body, signal) {
    return this.#send("POST", "/refine", body, { signal });
  }

  fill(body, signal) {
    return this.#send("POST", "/fill", body, { signal });
  }

  mesh(body, signal) {
    return this.#send("POST", "/mesh", body, { signal });
  }

  async content(id, signal) {
    const answer = await ask(`${this.path}/contents/${id}`, { headers: this.#headers(), signal });
    return new Uint8Array(await answer.arrayBuffer());
  }

  /** `how` is update, duplicate or dry_run for items that exist already and differ; without it they are skipped. */
  import(file, format, set, how = {}) {
    // The list of the items has the name of the file without its ending.
    const list = file.name.replace(/\.(mrk\.json|seg\.nrrd|nii\.gz|[^.]+)$/i, "").slice(0, 120);
    const query = new URLSearchParams({ set, ...(list ? { list } : {}), ...(format ? { format } : { name: file.name }), ...how });
    return this.#send("POST", `/import?${query}`, file, { type: "application/octet-stream" });
  }

  /** Stores a report or a segmentation in an archive: the outcome, and the items that the format cannot represent. */
  store(archive, format, set) {
    return this.#send("POST", "/store", { archive, format, ...(set ? { set } : {}) });
  }

  /** The file as a blob, its name, and the number of items that the format cannot represent. */
  async export(format, set) {
    const query = new URLSearchParams({ format, ...(set ? { set } : {}) });
    const answer = await ask(`${this.path}/export?${query}`, { headers: this.#headers() });
    const name = /filename="([^"]+)"/.exec(answer.headers.get("Content-Disposition") ?? "")?.[1];
    const leftOut = Number(answer.headers.get("Relief-Left-Out") ?? 0);
    return { blob: await answer.blob(), name: name ?? `annotations.${format}`, leftOut };
  }

  /** Creates a set; an existing description is kept. */
  putSet(set) {
    const { name, ...rest } = set;
    return this.#send("PUT", `/sets/${encodeURIComponent(name)}`, rest, { more: { "If-None-Match": "*" } });
  }

  async templates() {
    const answer = await ask(`${this.path}/templates`, { headers: this.#headers() });
    const { templates, ready } = await answer.json();
    return [...templates, ...ready];
  }

  async template(name) {
    const answer = await ask(`${this.path}/templates/${encodeURIComponent(name)}`, { headers: this.#headers() });
    return answer.json();
  }

  putTemplate(name, template) {
    return this.#send("PUT", `/templates/${encodeURIComponent(name)}`, template);
  }

  applyTemplate(name, set) {
    return this.#send("POST", `/templates/${encodeURIComponent(name)}/apply?set=${encodeURIComponent(set)}`, {});
  }
}
