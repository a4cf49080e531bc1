// Who is signed in, the way to the sign-in page, and tickets for WebSockets.

/** Leaves for the sign-in page, which leads back here. */
export function signIn() {
  location.assign(`/sign-in?next=${encodeURIComponent(location.pathname + location.hash)}`);
}

/** `{ required, name, scope, sign_out }`: on an open server, nobody has to sign in. */
async function whoAmI() {
  const answer = await fetch("/v1/identity", { cache: "no-store" });
  return answer.ok ? answer.json() : { required: false, name: null, scope: null, sign_out: false };
}

/** Adds a ticket to the address of a WebSocket where the server asks for one: a cookie opens none. */
export async function withTicket(url) {
  // With the same query, so that a load balancer sends both to the same server.
  const answer = await fetch(`/v1/session/ticket${url.search}`, { method: "POST" }).catch(() => null);
  if (answer?.status === 401) signIn();
  if (answer?.status === 200) url.searchParams.set("ticket", (await answer.json()).ticket);
  return url;
}

/** Shows in `button` who is signed in; pressing it signs out. */
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
