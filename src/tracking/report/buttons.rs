//! The eleven buttons, as two bytes of which some bits belong to the accelerometer.

/// Buttons held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Buttons(u16);

/// Bits that are buttons; bits 5 and 6 of both bytes are the accelerometer's.
const MASK: u16 = 0x1f9f;

macro_rules! buttons {
    ($($(#[$doc:meta])* $constant:ident = $bit:literal, $name:literal;)*) => {
        impl Buttons {
            $($(#[$doc])* pub const $constant: Self = Self($bit);)*
            /// Every button with its name.
            pub const ALL: &[(Self, &str)] = &[$((Self::$constant, $name)),*];
        }
    };
}

buttons! {
    /// Cross, left.
    LEFT = 0x0100, "left";
    /// Cross, right.
    RIGHT = 0x0200, "right";
    /// Cross, down: towards the plug.
    DOWN = 0x0400, "down";
    /// Cross, up: towards the camera.
    UP = 0x0800, "up";
    /// +.
    PLUS = 0x1000, "plus";
    /// 2.
    TWO = 0x0001, "two";
    /// 1.
    ONE = 0x0002, "one";
    /// B, the trigger below.
    B = 0x0004, "b";
    /// A.
    A = 0x0008, "a";
    /// -.
    MINUS = 0x0010, "minus";
    /// The house.
    HOME = 0x0080, "home";
}

impl Buttons {
    /// The buttons of a report's first two bytes; other bits are left out.
    #[must_use]
    pub fn from_bytes(bytes: [u8; 2]) -> Self {
        Self(u16::from_be_bytes(bytes) & MASK)
    }

    /// The two bytes, with the accelerometer's bits zero.
    #[must_use]
    pub fn to_bytes(self) -> [u8; 2] {
        self.0.to_be_bytes()
    }

    /// These buttons and those.
    #[must_use]
    pub const fn with(self, others: Self) -> Self {
        Self(self.0 | others.0)
    }

    /// These buttons, but not those.
    #[must_use]
    pub const fn without(self, others: Self) -> Self {
        Self(self.0 & !others.0)
    }

    /// Whether all of those are held.
    #[must_use]
    pub const fn contains(self, others: Self) -> bool {
        self.0 & others.0 == others.0
    }

    /// Names of the buttons held.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Self::ALL.iter().filter(move |(button, _)| self.contains(*button)).map(|(_, name)| *name)
    }
}
