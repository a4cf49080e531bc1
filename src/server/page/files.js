// Files: saves the server's responses, and uploads a chosen or dropped zip.

import { request } from "./view.js";

/** Saves a response as a file. */
export async function saveAs(name, url, accept) {
  const answer = await request(url, { headers: { Accept: accept } });
  const link = document.createElement("a");
  link.href = URL.createObjectURL(await answer.blob());
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** Uploads a series as a zip; returns the description of its volume. */
export async function uploadZip(file) {
  const headers = { "Content-Type": "application/zip" };
  return (await request("/v1/volumes", { method: "POST", headers, body: file })).json();
}

/** Calls back with a file that the user chooses with a button or drops on the stage. */
export function onFile(stage, buttons, input, take) {
  for (const button of buttons) button.addEventListener("click", () => input.click());
  input.addEventListener("change", () => {
    if (input.files[0]) take(input.files[0]);
    input.value = "";
  });
  stage.addEventListener("dragover", (event) => {
    event.preventDefault();
    stage.classList.add("dropping");
  });
  stage.addEventListener("dragleave", () => stage.classList.remove("dropping"));
  stage.addEventListener("drop", (event) => {
    event.preventDefault();
    stage.classList.remove("dropping");
    if (event.dataTransfer.files[0]) take(event.dataTransfer.files[0]);
  });
}
