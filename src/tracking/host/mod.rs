//! Bringing a remote's camera up, step by step, and keeping it up.
//!
//! A [`Host`] receives the time and the remote's reports, and returns the next report to send; it
//! has no device of its own. Each step waits for its answer, because a hurried camera ends up at a
//! random sensitivity. Later it watches the remote: an unrequested status means that reporting
//! stopped, a foreign report id that a driver set its own mode, and silence that the remote is
//! gone. It answers each by repeating the set-up, the last from the first step.

mod remote;

pub use remote::{RemoteSenses, VirtualRemote};

use super::report::calibration::{Calibrations, EEPROM_BYTES};
use super::report::motion_plus::GyroCalibration;
use super::report::output::{DataMode, MemorySpace, Output};
use super::report::{InputReport, IrFormat, Layout};

/// How bright a spot has to be: the highest level that sees no stray light gives the finest
/// positions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sensitivity {
    /// The least sensitive.
    Level1,
    /// 2.
    Level2,
    /// The mode that Linux' driver sets.
    #[default]
    Level3,
    /// 4.
    Level4,
    /// 5.
    Level5,
    /// The most sensitive.
    Max,
}

impl Sensitivity {
    /// From 1 to 6, the last being the most sensitive.
    #[must_use]
    pub fn of_level(level: u8) -> Option<Self> {
        use Sensitivity::{Level1, Level2, Level3, Level4, Level5, Max};
        let at = usize::from(level).checked_sub(1)?;
        [Level1, Level2, Level3, Level4, Level5, Max].get(at).copied()
    }

    /// The values of registers 0xb00000 and 0xb0001a.
    #[must_use]
    pub const fn blocks(self) -> ([u8; 9], [u8; 2]) {
        match self {
            Self::Level1 => ([0x02, 0, 0, 0x71, 0x01, 0, 0x64, 0, 0xfe], [0xfd, 0x05]),
            Self::Level2 => ([0x02, 0, 0, 0x71, 0x01, 0, 0x96, 0, 0xb4], [0xb3, 0x04]),
            Self::Level3 => ([0x02, 0, 0, 0x71, 0x01, 0, 0xaa, 0, 0x64], [0x63, 0x03]),
            Self::Level4 => ([0x02, 0, 0, 0x71, 0x01, 0, 0xc8, 0, 0x36], [0x35, 0x03]),
            Self::Level5 => ([0x07, 0, 0, 0x71, 0x01, 0, 0x72, 0, 0x20], [0x1f, 0x03]),
            Self::Max => ([0x00, 0, 0, 0x00, 0x00, 0, 0x90, 0, 0x41], [0x40, 0x00]),
        }
    }
}

/// The host's requests to the remote.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HostOptions {
    /// The camera's sensitivity.
    pub sensitivity: Sensitivity,
    /// Blobs in full, over two reports: half the rate.
    pub full: bool,
    /// Use a MotionPlus, if there is one.
    pub gyroscope: bool,
}

/// The state of the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HostState {
    /// The number of this step, and the number of all steps.
    Starting(usize, usize),
    /// The remote reports as it should.
    Running,
    /// The remote refuses a step that it must not refuse, again and again: is it one?
    Refused,
}

#[derive(Clone, Copy, Debug)]
enum Answer {
    Acknowledge,
    /// Memory up to this many bytes.
    Memory(usize),
}

#[derive(Clone, Copy, Debug)]
struct SetupStep {
    output: Output,
    answer: Answer,
    /// Whether it may fail: no MotionPlus is no mistake.
    optional: bool,
}

const ANSWER_NS: u64 = 200_000_000;
const SILENCE_NS: u64 = 1_000_000_000;
const MAX_TRIES: u32 = 10;
const MOTION_PLUS_CALIBRATION: u32 = 0xa6_0020;
const MAX_STEPS: usize = 12;

/// See the module.
#[derive(Clone, Debug)]
pub struct Host {
    options: HostOptions,
    steps: Vec<SetupStep>,
    at: usize,
    sent_ns: Option<u64>,
    tries: u32,
    heard_ns: Option<u64>,
    asked_ns: u64,
    memory: Vec<u8>,
    mode_wanted: bool,
    eeprom: Option<Calibrations>,
    gyroscope: Option<GyroCalibration>,
    restarts: u32,
}

impl Host {
    /// A host that has not begun.
    #[must_use]
    pub fn new(options: HostOptions) -> Self {
        Self {
            options,
            steps: steps(&options),
            at: 0,
            sent_ns: None,
            tries: 0,
            heard_ns: None,
            asked_ns: 0,
            memory: Vec::new(),
            mode_wanted: false,
            eeprom: None,
            gyroscope: None,
            restarts: 0,
        }
    }

    /// Its state.
    #[must_use]
    pub fn state(&self) -> HostState {
        match self.at {
            _ if self.tries > MAX_TRIES => HostState::Refused,
            at if at < self.steps.len() => HostState::Starting(at, self.steps.len()),
            _ => HostState::Running,
        }
    }

    /// The number of its restarts.
    #[must_use]
    pub fn restarts(&self) -> u32 {
        self.restarts
    }

    /// The data of the EEPROM.
    #[must_use]
    pub fn calibrations(&self) -> Option<Calibrations> {
        self.eeprom
    }

    /// The data of the MotionPlus.
    #[must_use]
    pub fn gyroscope(&self) -> Option<GyroCalibration> {
        self.gyroscope
    }

    /// The report to send now, if any. Call it after every report, and every 50 ms or so.
    pub fn poll(&mut self, now_ns: u64) -> Option<Output> {
        let silent = self.heard_ns.is_some_and(|heard| now_ns.saturating_sub(heard) > SILENCE_NS);
        if silent && self.at > 0 && self.state() != HostState::Refused {
            self.restart();
        }
        let Some(step) = self.steps.get(self.at).copied() else {
            let due = self.mode_wanted && now_ns.saturating_sub(self.asked_ns) > ANSWER_NS;
            self.mode_wanted &= !due;
            return due.then(|| {
                self.asked_ns = now_ns;
                mode(&self.options)
            });
        };
        let waiting = self.sent_ns.is_some_and(|sent| now_ns.saturating_sub(sent) < ANSWER_NS);
        if waiting || self.state() == HostState::Refused {
            return None;
        }
        self.tries += 1;
        if step.optional && self.tries > 3 {
            self.next();
            return self.poll(now_ns);
        }
        self.sent_ns = Some(now_ns);
        self.memory.clear();
        Some(step.output)
    }

    /// Takes a report of the remote.
    pub fn take(&mut self, now_ns: u64, report: &InputReport) {
        self.heard_ns = Some(now_ns);
        match report {
            InputReport::Acknowledge(ack) => self.take_acknowledgement(ack.of, ack.error),
            InputReport::Memory(memory) => self.take_memory(memory),
            // After a status nothing is reported until the mode is set again.
            InputReport::Status(_) => self.mode_wanted = true,
            InputReport::Data(_) | InputReport::Interleaved(_) => {
                let DataMode::Single(wanted) = data_mode(&self.options) else {
                    self.mode_wanted |= !matches!(report, InputReport::Interleaved(_));
                    return;
                };
                self.mode_wanted |= report.id() != wanted.id();
            }
        }
    }

    fn take_acknowledgement(&mut self, of: u8, error: u8) {
        let Some(step) = self.steps.get(self.at) else { return };
        let is_answer = matches!(step.answer, Answer::Acknowledge) && step.output.id() == of;
        if !is_answer || self.sent_ns.is_none() {
            return;
        }
        if error == 0 || step.optional {
            self.next();
        } else {
            self.sent_ns = None; // again at once; the number of tries is limited
        }
    }

    fn take_memory(&mut self, memory: &super::report::Memory) {
        let Some(SetupStep { output, answer: Answer::Memory(wanted), optional }) =
            self.steps.get(self.at).copied()
        else {
            return;
        };
        if memory.error != 0 {
            if optional {
                self.next();
            }
            return;
        }
        let Output::Read { space, address, .. } = output else { return };
        let expected = (address as usize + self.memory.len()) & 0xffff;
        if usize::from(memory.address) != expected {
            return; // of an earlier try
        }
        self.memory.extend(memory.bytes());
        if self.memory.len() >= wanted {
            match space {
                MemorySpace::Eeprom => self.eeprom = Calibrations::decode(&self.memory).ok(),
                MemorySpace::Registers => {
                    self.gyroscope =
                        self.memory.get(..32).and_then(|b| GyroCalibration::decode(b.as_array()?));
                }
            }
            self.next();
        }
    }

    fn next(&mut self) {
        self.at += 1;
        self.tries = 0;
        self.sent_ns = None;
        self.memory.clear();
    }

    fn restart(&mut self) {
        self.at = 0;
        self.tries = 0;
        self.sent_ns = None;
        self.heard_ns = None;
        self.mode_wanted = false;
        self.restarts += 1;
    }
}

fn data_mode(options: &HostOptions) -> DataMode {
    match (options.full, options.gyroscope) {
        (true, _) => DataMode::Interleaved,
        (false, true) => DataMode::Single(Layout::AccelerationIrExtension6),
        (false, false) => DataMode::Single(Layout::AccelerationIr),
    }
}

fn mode(options: &HostOptions) -> Output {
    Output::Mode { continuous: true, mode: data_mode(options) }
}

/// The order is that of Linux' driver.
fn steps(options: &HostOptions) -> Vec<SetupStep> {
    let format = match data_mode(options) {
        DataMode::Interleaved => IrFormat::Full,
        DataMode::Single(layout) => layout.ir().unwrap_or(IrFormat::Extended),
    };
    let (block1, block2) = options.sensitivity.blocks();
    let acknowledged = |output| SetupStep { output, answer: Answer::Acknowledge, optional: false };
    let mut steps = Vec::with_capacity(MAX_STEPS);
    steps.push(SetupStep {
        output: Output::Read { space: MemorySpace::Eeprom, address: 0, length: EEPROM_BYTES as u16 },
        answer: Answer::Memory(EEPROM_BYTES),
        optional: true,
    });
    if options.gyroscope {
        let address = MOTION_PLUS_CALIBRATION;
        let read = Output::Read { space: MemorySpace::Registers, address, length: 32 };
        let optional = |output| SetupStep { output, answer: Answer::Acknowledge, optional: true };
        steps.push(SetupStep { output: read, answer: Answer::Memory(32), optional: true });
        steps.push(optional(Output::register(0xa6_00f0, &[0x55])));
        steps.push(optional(Output::register(0xa6_00fe, &[0x04])));
    }
    steps.extend(
        [
            Output::CameraClock(true),
            Output::CameraLogic(true),
            Output::register(0xb0_0030, &[0x01]),
            Output::register(0xb0_0000, &block1),
            Output::register(0xb0_001a, &block2),
            Output::register(0xb0_0033, &[format as u8]),
            Output::register(0xb0_0030, &[0x08]),
            mode(options),
        ]
        .map(acknowledged),
    );
    steps
}

#[cfg(test)]
mod tests;
