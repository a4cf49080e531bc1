//! Signing in from the pages.

use serde_json::json;

use super::{driven, skipped};

/// Invariant: Pages of a server with tokens lead to the sign-in page and back, and live sessions open
/// by tickets.
#[test]
fn pages_lead_to_the_sign_in_page_and_back() {
    let what = "signing in";
    let Some(seen) = driven("identity.py", "64", false) else { return skipped(what) };
    assert_eq!(seen["led_to"], "/sign-in?next=/annotate");
    assert_eq!(seen["wrong_token"], "This token is unknown or has expired.");
    assert_eq!(seen["back_at"], "/annotate");
    assert!(seen["author"].as_str().unwrap().contains("anna"), "{seen}");
    assert_eq!(seen["sign_out"], "Signed in as anna (annotate)");
    assert_eq!((&seen["cookie_is_hidden"], &seen["kiosk"]), (&json!(true), &json!(true)));
    assert_eq!(seen["picture"], true);
    assert_eq!(seen["after"], "/sign-in?next=/");
    assert_eq!(seen["elsewhere"], json!(["/", "/", "/", "/", "/", "/", "/"]));
    assert_eq!(seen["failures"], json!([]));
}
