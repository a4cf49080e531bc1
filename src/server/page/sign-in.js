// The sign-in page: exchanges a token for a cookie that scripts cannot read.

const form = document.getElementById("form");
const problem = document.getElementById("problem");

/** The page to open afterwards: a path of this server only. */
function next() {
  const wanted = new URLSearchParams(location.search).get("next") ?? "/";
  const url = new URL(wanted, location.origin);
  return url.origin === location.origin && url.pathname !== "/sign-in" ? url.pathname + url.hash : "/";
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
