//! The choice of an adapter.

use super::error::GpuError;
use crate::gpu::choice::AdapterChoice;

/// The kind of an adapter's device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum AdapterKind {
    /// The processor's own ray caster.
    Processor,
    /// A rasteriser on the CPU, such as lavapipe.
    Software,
    /// Something the driver does not classify.
    Other,
    /// A GPU lent to a virtual machine.
    Virtual,
    /// A GPU that shares the CPU's memory.
    Integrated,
    /// A GPU with memory of its own.
    Discrete,
}

/// An adapter in words.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct AdapterDescription {
    /// Name of the device.
    pub name: String,
    /// Name and version of its driver.
    pub driver: String,
    /// The graphics API in use.
    pub backend: String,
    /// The kind of the device.
    pub kind: AdapterKind,
}

impl AdapterDescription {
    pub(super) fn of(adapter: &wgpu::Adapter) -> Self {
        let info = adapter.get_info();
        let kind = match info.device_type {
            wgpu::DeviceType::Cpu => AdapterKind::Software,
            wgpu::DeviceType::VirtualGpu => AdapterKind::Virtual,
            wgpu::DeviceType::IntegratedGpu => AdapterKind::Integrated,
            wgpu::DeviceType::DiscreteGpu => AdapterKind::Discrete,
            wgpu::DeviceType::Other => AdapterKind::Other,
        };
        let driver = format!("{} {}", info.driver, info.driver_info).trim().to_owned();
        Self { name: info.name, driver, backend: info.backend.to_string(), kind }
    }

    fn matches(&self, choice: &AdapterChoice) -> bool {
        match choice {
            AdapterChoice::Best => true,
            AdapterChoice::Processor => false,
            AdapterChoice::Software => self.kind == AdapterKind::Software,
            AdapterChoice::Named(part) => {
                let part = part.to_lowercase();
                self.name.to_lowercase().contains(&part) || self.driver.to_lowercase().contains(&part)
            }
        }
    }
}

impl std::fmt::Display for AdapterDescription {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({}, {})", self.name, self.driver, self.backend)
    }
}

/// Every adapter of this machine.
#[must_use]
pub fn adapters() -> Vec<AdapterDescription> {
    enumerate().iter().map(AdapterDescription::of).collect()
}

/// Whether there is a graphics card, and not a rasteriser on the processor alone.
pub(crate) fn has_card() -> bool {
    adapters().iter().any(|adapter| adapter.kind > AdapterKind::Software)
}

fn enumerate() -> Vec<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY))
}

/// The adapter of this choice with the most capable kind.
pub(super) fn choose(choice: &AdapterChoice) -> Result<wgpu::Adapter, GpuError> {
    let found = enumerate();
    let available: Vec<String> = found.iter().map(|a| AdapterDescription::of(a).to_string()).collect();
    let fitting = found.into_iter().filter(|adapter| AdapterDescription::of(adapter).matches(choice));
    // `max_by_key` takes the last of equals; the driver's own order puts the preferred one first.
    let mut fitting: Vec<wgpu::Adapter> = fitting.collect();
    fitting.reverse();
    fitting
        .into_iter()
        .max_by_key(|adapter| AdapterDescription::of(adapter).kind)
        .ok_or_else(|| GpuError::NoAdapter { wanted: choice.clone(), available })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn description(name: &str, kind: AdapterKind) -> AdapterDescription {
        AdapterDescription { name: name.into(), driver: "Mesa 25".into(), backend: "vulkan".into(), kind }
    }

    #[test]
    fn a_choice_is_by_kind_or_by_part_of_a_name() {
        let software = description("llvmpipe", AdapterKind::Software);
        let discrete = description("Radeon", AdapterKind::Discrete);
        assert!(software.matches(&AdapterChoice::parse("software")));
        assert!(!discrete.matches(&AdapterChoice::parse("software")));
        assert!(discrete.matches(&AdapterChoice::parse("radeon")));
        assert!(software.matches(&AdapterChoice::parse("mesa")));
        assert!(discrete.kind > software.kind);
    }
}
