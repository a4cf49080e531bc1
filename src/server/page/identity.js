// The signed-in user, redirection to the sign-in page, and tickets for WebSockets.

/** Opens the sign-in page, which returns to this one. */
export function signIn() {
  location.assign(`/sign-in?next=${encodeURIComponent(location.pathname + location.hash)}`);
}

/** `{ required, name, scope, sign_out }`: an open server requires no sign-in. */
async function whoAmI() {
  const answer = await fetch("/v1/identity", { cache: "no-store" });
  return answer.ok ? answer.json() : { required: false, name: null, scope: null, sign_out: false };
}

/** Adds a ticket to the address of a WebSocket if the server requires one: it accepts no cookie there. */
export async function withTicket(url) {
  // With the same query, so that a load balancer sends both to the same server.
  const answer = await fetch(`/v1/session/ticket${url.search}`, { method: "POST" }).catch(() => null);
  if (answer?.status === 401) signIn();
  if (answer?.status === 200) url.searchParams.set("ticket", (await answer.json()).ticket);
  return url;
}

/** Displays the signed-in user in `button`, which signs out. */
export async function showIdentity(button) {
  const identity = await whoAmI();
  button.hidden = !identity.sign_out;
  if (button.hidden) return identity;
  button.textContent = "Sign out";
  button.title = `Signed in as ${identity.name} (${identity.scope})`;
  button.addEventListener("click", async () => {
    await fetch("/v1/sign-out", { method: "POST" });
    signIn();
  });
  return identity;
}
