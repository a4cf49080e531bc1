// Files: imports dropped and chosen files, and saves exported ones.

import { askImport } from "./dialogs.js";
import { FORMATS } from "./formats.js";

/** Endings beside the formats' own names. */
const ENDINGS = { json: "", dcm: "", nrrd: "seg.nrrd", nii: "nii.gz", nii_gz: "nii.gz" };

/** The format that a name tells; empty where the content has to. */
function formatOf(name) {
  const lower = name.toLowerCase();
  const known = FORMATS.map(({ name }) => name).sort((a, b) => b.length - a.length).find((format) => lower.endsWith(`.${format}`));
  return known ?? ENDINGS[lower.split(".").pop()] ?? "";
}

/** The reason of a refusal, for people who drop files and set no parameters. */
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

  /** What becomes of items of a file that are there and differ: a query of the import, or null where nothing is imported. */
  async #treatment(file) {
    const { there } = await this.annotations().import(file, formatOf(file.name), this.model.set, { dry_run: true });
    return there.skipped ? askImport(file.name, there.skipped) : {};
  }

  /** Imports one after the other; each is taken whole or not at all. */
  async take(files) {
    if (!files.length || !this.isOn() || !(await this.named())) return;
    const told = [];
    for (const file of files) {
      try {
        const how = await this.#treatment(file);
        if (!how) continue;
        const { events, warnings = [] } = await this.annotations().import(file, formatOf(file.name), this.model.set, how);
        await this.took(events);
        told.push(`${file.name}: ${events.length} item${events.length === 1 ? "" : "s"}`, ...warnings);
        const first = events.find(({ item }) => item?.geometry);
        if (first) this.model.jumpTo(first.item.id);
      } catch (error) {
        this.fail(Object.assign(error, { message: `${file.name}: ${reasonOf(error)}. Nothing was changed.` }));
      }
    }
    if (told.length) this.say(told.join(". "));
  }

  async save({ format, set }) {
    try {
      const { blob, name, leftOut } = await this.annotations().export(format, set);
      const link = document.createElement("a");
      link.href = URL.createObjectURL(blob);
      link.download = name;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
      const rest = leftOut ? ` ${leftOut} item${leftOut === 1 ? "" : "s"} cannot be told in this format and ${leftOut === 1 ? "is" : "are"} left out.` : "";
      this.say(`Saved ${name}.${rest}`, { brief: !leftOut });
    } catch (error) {
      this.fail(error);
    }
  }
}
