//! Value representations (PS3.5 6.2): the part of them that decides the length of an element.

/// Whether two bytes look like a value representation.
pub(super) fn is_vr(vr: [u8; 2]) -> bool {
    vr.iter().all(u8::is_ascii_uppercase)
}

/// Whether a VR is followed by a 32-bit length. The short ones are listed: PS3.5 gives future VRs
/// the long form.
pub(super) fn has_long_length(vr: [u8; 2]) -> bool {
    const SHORT: [&[u8; 2]; 21] = [
        b"AE", b"AS", b"AT", b"CS", b"DA", b"DS", b"DT", b"FL", b"FD", b"IS", b"LO", b"LT", b"PN", b"SH",
        b"SL", b"SS", b"ST", b"TM", b"UI", b"UL", b"US",
    ];
    !SHORT.contains(&&vr)
}
