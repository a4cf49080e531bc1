//! Calls of a backend that may panic.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// A call of the backend. A panic in it becomes its message and the thread continues: one bad
/// request must not stop the frames of all others. The backend is used again afterwards, so it must
/// not rely on having finished a call.
pub(super) fn guarded<T>(call: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(call)).map_err(|panic| panic_text(panic.as_ref()))
}

fn panic_text(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().copied();
    text.or_else(|| panic.downcast_ref::<String>().map(String::as_str)).unwrap_or("no message").to_owned()
}
