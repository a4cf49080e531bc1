// The sign-in page: exchanges a token for a cookie that scripts cannot read.

const form = document.getElementById("form");
const problem = document.getElementById("problem");

/** The page to open afterwards: a path of this server only. A path that begins with two slashes would name another host. */
function next() {
  const wanted = new URLSearchParams(location.search).get("next") ?? "/";
  const url = new URL(wanted, location.origin);
  const isHere = url.origin === location.origin && !/^[/\\]{2}/.test(url.pathname);
  return isHere && url.pathname !== "/sign-in" ? url.pathname + url.hash : "/";
}

function fail(text) {
  problem.textContent = text;
  problem.hidden = false;
  form.token.select();
}

form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const options = { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ token: form.token.value.trim() }) };
  const answer = await fetch("/v1/sign-in", options).catch(() => null);
  if (!answer) return fail("The server does not answer.");
  if (answer.ok) return location.replace(next());
  const { detail } = await answer.json().catch(() => ({}));
  fail(answer.status === 401 ? "This token is unknown or has expired." : (detail ?? `The server answered ${answer.status}.`));
});
