//! A simulated remote: a Wiimote's answers to output reports, as far as its camera is concerned.
//!
//! It keeps EEPROM and registers, acknowledges as the real one does, and shows blobs only when the
//! camera was brought up in the right order and the report's layout fits the camera's format, with
//! all ones otherwise.

use std::collections::BTreeMap;

use crate::report::calibration::{AccelerometerCalibration, IrCalibration, encode_accelerometer, encode_ir};
use crate::report::motion_plus::{GyroCalibration, MotionPlus};
use crate::report::output::{DataMode, MemorySpace, Output};
use crate::report::{
    Acceleration, Acknowledge, Blob, Buttons, DataReport, Extension, Half, InputReport, InterleavedHalf,
    IrFormat, Layout, Memory, Status,
};

const CAMERA: u32 = 0xb0_0000;

/// Its acceleration, rotation and camera picture.
#[derive(Clone, Copy, Debug, Default)]
pub struct RemoteSenses {
    /// Buttons held.
    pub buttons: Buttons,
    /// Acceleration, raw.
    pub acceleration: Acceleration,
    /// Blobs, with whatever detail the camera's format has room for.
    pub blobs: [Option<Blob>; 4],
    /// Rates of a MotionPlus.
    pub rates: Option<MotionPlus>,
}

/// See the module.
#[derive(Clone, Debug)]
pub struct VirtualRemote {
    eeprom: Vec<u8>,
    registers: BTreeMap<u32, u8>,
    clock: bool,
    logic: bool,
    mode: DataMode,
    continuous: bool,
    leds: u8,
    has_motion_plus: bool,
    second_half: bool,
}

impl VirtualRemote {
    /// A remote that was just switched on; with a MotionPlus plugged in or not.
    #[must_use]
    pub fn new(has_motion_plus: bool) -> Self {
        let corners = [(127, 674), (896, 674), (896, 93), (127, 93)].map(|(x, y)| Blob::at(x, y));
        let ir = encode_ir(&IrCalibration { corners });
        let accelerometer = encode_accelerometer(&AccelerometerCalibration::TYPICAL);
        let mut eeprom = [ir.as_slice(), &ir, &accelerometer, &accelerometer].concat();
        eeprom.resize(0x1700, 0);
        let mut registers = BTreeMap::new();
        if has_motion_plus {
            let calibration = GyroCalibration::TYPICAL.encode([0x0b, 0xe9]);
            registers.extend((0xa6_0020..).zip(calibration));
        }
        let mode = DataMode::Single(Layout::Buttons);
        Self {
            eeprom,
            registers,
            clock: false,
            logic: false,
            mode,
            continuous: false,
            leds: 0,
            has_motion_plus,
            second_half: false,
        }
    }

    /// Whether data reports come also when nothing changes.
    #[must_use]
    pub fn is_continuous(&self) -> bool {
        self.continuous
    }

    /// The content of a register.
    #[must_use]
    pub fn register(&self, address: u32) -> u8 {
        self.registers.get(&address).copied().unwrap_or(0)
    }

    /// The answers to an output report.
    pub fn take(&mut self, output: &Output) -> Vec<InputReport> {
        let done = |of| vec![acknowledge(of, 0)];
        match *output {
            Output::Rumble | Output::Speaker(_) | Output::Mute(_) => Vec::new(),
            Output::Leds(leds) => {
                self.leds = leds;
                Vec::new()
            }
            Output::Mode { continuous, mode } => {
                (self.continuous, self.mode) = (continuous, mode);
                done(0x12)
            }
            Output::CameraClock(on) => {
                self.clock = on;
                done(0x13)
            }
            Output::CameraLogic(on) => {
                self.logic = on;
                done(0x1a)
            }
            Output::Status => vec![self.status()],
            Output::Write { space, address, length, data } => {
                self.write(space, address, &data[..usize::from(length.min(16))])
            }
            Output::Read { space, address, length } => self.read(space, address, length),
        }
    }

    /// A status report: requested, or sent when an extension is plugged in or out.
    #[must_use]
    pub fn status(&self) -> InputReport {
        InputReport::Status(Status {
            buttons: Buttons::default(),
            battery_low: false,
            extension: self.has_motion_plus,
            speaker: false,
            camera: self.clock && self.logic,
            leds: self.leds & 0x0f,
            battery: 149,
        })
    }

    fn write(&mut self, space: MemorySpace, address: u32, bytes: &[u8]) -> Vec<InputReport> {
        let is_camera = address & 0xff_0000 == CAMERA;
        let is_motion_plus = address & 0xff_0000 == 0xa6_0000;
        let error = match space {
            MemorySpace::Eeprom => 8,
            // A camera without clock and logic ignores writes.
            MemorySpace::Registers if is_camera && !(self.clock && self.logic) => 8,
            MemorySpace::Registers if is_motion_plus && !self.has_motion_plus => 7,
            MemorySpace::Registers => 0,
        };
        if error == 0 {
            self.registers.extend((address..).zip(bytes.iter().copied()));
        }
        vec![acknowledge(0x16, error)]
    }

    fn read(&self, space: MemorySpace, address: u32, length: u16) -> Vec<InputReport> {
        let byte = |at: u32| match space {
            MemorySpace::Eeprom => self.eeprom.get(at as usize).copied(),
            MemorySpace::Registers => self.registers.get(&at).copied(),
        };
        let mut reports = Vec::new();
        for start in (0..u32::from(length)).step_by(16) {
            let count = (u32::from(length) - start).min(16);
            let at = address + start;
            let found: Option<Vec<u8>> = (at..at + count).map(byte).collect();
            let mut data = [0; 16];
            for (slot, byte) in data.iter_mut().zip(found.iter().flatten()) {
                *slot = *byte;
            }
            let error = if found.is_some() { 0 } else { 7 };
            let buttons = Buttons::default();
            reports.push(InputReport::Memory(Memory {
                buttons,
                error,
                address: (at & 0xffff) as u16,
                length: count as u8,
                data,
            }));
            if error != 0 {
                break;
            }
        }
        reports
    }

    /// The next data report.
    pub fn report(&mut self, senses: &RemoteSenses) -> InputReport {
        let layout = match self.mode {
            DataMode::Interleaved => return self.half(senses),
            DataMode::Single(layout) => layout,
        };
        let sees = layout.ir().is_some_and(|format| self.sees(format));
        let blobs = layout.ir().map(|format| {
            let shown = |blob: Blob| match format {
                IrFormat::Extended => Blob { size: blob.size.or(Some(2)), extent: None, ..blob },
                _ => Blob::at(blob.x, blob.y),
            };
            if sees { senses.blobs.map(|blob| blob.map(shown)) } else { [None; 4] }
        });
        let rates = senses.rates.filter(|_| self.register(0xa6_00fe) == 0x04);
        let mut extension = rates.map_or([0xff; 6], |rates| rates.encode()).to_vec();
        extension.resize(layout.extension_bytes(), 0);
        InputReport::Data(DataReport {
            layout,
            buttons: layout.has_buttons().then_some(senses.buttons),
            acceleration: layout.has_acceleration().then_some(senses.acceleration),
            blobs,
            extension: (!extension.is_empty()).then(|| Extension::new(&extension)),
        })
    }

    fn half(&mut self, senses: &RemoteSenses) -> InputReport {
        let half = if self.second_half { Half::Second } else { Half::First };
        self.second_half = !self.second_half;
        let [x, y, z] = senses.acceleration.map(|count| (count >> 2) as u8);
        let [a, b, c, d] = if self.sees(IrFormat::Full) { senses.blobs } else { [None; 4] };
        let (acceleration, z_bits, blobs) =
            if half == Half::First { (x, z >> 4, [a, b]) } else { (y, z & 0x0f, [c, d]) };
        InputReport::Interleaved(InterleavedHalf {
            half,
            buttons: senses.buttons,
            acceleration,
            z_bits,
            blobs,
        })
    }

    /// Whether the camera runs, with a sensitivity, in this format.
    fn sees(&self, format: IrFormat) -> bool {
        self.clock
            && self.logic
            && self.register(CAMERA + 0x30) == 0x08
            && self.register(CAMERA + 0x33) == format as u8
            && self.register(CAMERA + 0x08) != 0
    }
}

fn acknowledge(of: u8, error: u8) -> InputReport {
    InputReport::Acknowledge(Acknowledge { buttons: Buttons::default(), of, error })
}
