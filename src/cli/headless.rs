//! Keeps Vulkan away from window systems: Relief draws in memory.
//!
//! wgpu enables the extensions for surfaces wherever the loader has them. A layer of Mesa, `device_select`, then
//! connects to Wayland to find the compositor's device, and where `XDG_RUNTIME_DIR` is not set (containers, services)
//! libwayland prints an error for each attempt. The layer is off where `NODEVICE_SELECT` is 1.

/// Switches the layer off for Vulkan loaders.
#[cfg(target_os = "linux")]
const LAYER_OFF: &str = "NODEVICE_SELECT";

/// Starts this program again, without the layer, where the layer would print errors. The process stays the same.
///
/// The environment of a running program cannot be changed without `unsafe`, and the loader reads it.
#[cfg(target_os = "linux")]
pub(crate) fn leave_window_systems() {
    use std::os::unix::process::CommandExt;
    let is_set = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    // With these, users choose a device by the layer.
    if [LAYER_OFF, "XDG_RUNTIME_DIR", "MESA_VK_DEVICE_SELECT", "DRI_PRIME"].into_iter().any(is_set) {
        return;
    }
    let mut arguments = std::env::args_os();
    let (Ok(program), Some(name)) = (std::env::current_exe(), arguments.next()) else { return };
    // Returns only if it fails; then the errors are printed, and everything else works.
    let _ = std::process::Command::new(program).arg0(name).args(arguments).env(LAYER_OFF, "1").exec();
}

/// Other systems have no such layer.
#[cfg(not(target_os = "linux"))]
pub(crate) fn leave_window_systems() {}
