// Files: imports dropped and chosen files, and saves exported ones.

import { askImport } from "./dialogs.js";
import { FORMATS } from "./formats.js";

/** File name endings that are not names of formats. */
const ENDINGS = { json: "", dcm: "", nrrd: "seg.nrrd", nii: "nii.gz", nii_gz: "nii.gz" };

/** The format by the ending of a file name; empty if only the content can decide. */
function formatOf(name) {
  const lower = name.toLowerCase();
  const known = FORMATS.map(({ name }) => name).sort((a, b) => b.length - a.length).find((format) => lower.endsWith(`.${format}`));
  return known ?? ENDINGS[lower.split(".").pop()] ?? "";
}

/** The reason of a refusal, without references to query parameters. */
function reasonOf({ kind, message }) {
  if (kind !== "unknown-format") return message.replace(/\.$/, "");
  return `its format is unknown: give it the extension of a known format (${FORMATS.map(({ name }) => name).join(", ")})`;
}

export class Files {
  constructor(input, model, { annotations, took, say, fail, named, isOn }) {
    Object.assign(this, { input, model, annotations, took, say, fail, named, isOn });
    input.addEventListener("change", () => {
      const chosen = [...input.files];
      input.value = "";
      this.take(chosen);
    });
    const page = document.body;
    page.addEventListener("dragover", (event) => {
      event.preventDefault();
      page.classList.add("dropping");
    });
    page.addEventListener("dragleave", (event) => event.relatedTarget === null && page.classList.remove("dropping"));
    page.addEventListener("drop", (event) => {
      event.preventDefault();
      page.classList.remove("dropping");
      this.take([...event.dataTransfer.files]);
    });
  }

  choose() {
    this.input.click();
  }

  /** How to import items that exist already and differ: query parameters of the import; null cancels it. */
  async #treatment(file) {
    const { there } = await this.annotations().import(file, formatOf(file.name), this.model.set, { dry_run: true });
    return there.skipped ? askImport(file.name, there.skipped) : {};
  }

  /** Imports files one after another; each is imported completely or not at all. */
  async take(files) {
    if (!files.length || !this.isOn() || !(await this.named())) return;
    const messages = [];
    for (const file of files) {
      try {
        const how = await this.#treatment(file);
        if (!how) continue;
        const { events, warnings = [] } = await this.annotations().import(file, formatOf(file.name), this.model.set, how);
        await this.took(events);
        messages.push(`${file.name}: ${events.length} item${events.length === 1 ? "" : "s"}`, ...warnings);
        const first = events.find(({ item }) => item?.geometry);
        if (first) this.model.jumpTo(first.item.id);
      } catch (error) {
        this.fail(Object.assign(error, { message: `${file.name}: ${reasonOf(error)}. Nothing was changed.` }));
      }
    }
    if (messages.length) this.say(messages.join(". "));
  }

  async save({ format, set, to }) {
    try {
      if (to) return await this.#store(to, format, set);
      const { blob, name, leftOut } = await this.annotations().export(format, set);
      const link = document.createElement("a");
      link.href = URL.createObjectURL(blob);
      link.download = name;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
      this.say(`Saved ${name}.${leftOutWords(leftOut)}`, { brief: !leftOut });
    } catch (error) {
      this.fail(error);
    }
  }

  async #store(archive, format, set) {
    const { outcome, left_out: { length } } = await this.annotations().store(archive, format, set);
    const words = outcome === "stored" ? `Stored in ${archive}.` : `${archive} has these annotations already.`;
    this.say(`${words}${leftOutWords(length)}`, { brief: !length });
  }
}

/** The number of kinds of losses in words, such as colours or lists; an item may have several. */
function leftOutWords(count) {
  if (!count) return "";
  return ` ${count} ${count === 1 ? "kind" : "kinds"} of values cannot be represented in this format and ${count === 1 ? "is" : "are"} left out.`;
}
