//! Volume properties of 3D Slicer: `VolumeProperty` elements of its presets and scenes, and `.vp`
//! files of nine lines.
//!
//! Both write a function as its number of values and then the values: `4 0 0 100 1` is 0 at 0 and 1
//! at 100; colours have four values a point. Two points at one place are a step. Values of the
//! scalars, HU in a CT.

use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

use super::curve::{CoincidentNodes, Curve, Node};
use super::draft::{Draft, FoundFunction, light};
use super::error::{TransferImportError, TransferSyntaxError};
use super::space::ColorSpace;

/// Most elements of a file that are looked at.
const MAX_PROPERTIES: usize = 4096;

/// A volume property in Slicer's words, all of them texts.
#[derive(Clone, Debug, Default)]
struct Property {
    name: Option<String>,
    shade: Option<String>,
    /// Ambient, diffuse and specular.
    shares: [Option<String>; 3],
    specular_power: Option<String>,
    unit_mm: Option<String>,
    color: String,
    opacity: String,
    gradient: Option<String>,
}

/// All properties of a file.
pub(super) fn properties_in_xml(bytes: &[u8]) -> Result<Vec<FoundFunction<'_>>, TransferImportError> {
    let text = std::str::from_utf8(bytes).map_err(|error| TransferImportError::syntax("XML", error))?;
    let mut reader = Reader::from_str(text);
    let mut found: Vec<FoundFunction<'_>> = Vec::new();
    loop {
        let place = format!("XML, byte {}", reader.buffer_position());
        match reader.read_event().map_err(|error| TransferImportError::syntax(&place, error))? {
            Event::Start(element) | Event::Empty(element) if element.name().as_ref() == "VolumeProperty" => {
                if found.len() == MAX_PROPERTIES {
                    return Err(TransferImportError::syntax(
                        &place,
                        TransferSyntaxError::TooManyProperties(MAX_PROPERTIES),
                    ));
                }
                let property = property_of(&element, &place)?;
                found.push((property.name.clone(), Box::new(move || property.draft())));
            }
            Event::Eof => return Ok(found),
            _ => {}
        }
    }
}

fn property_of(element: &BytesStart<'_>, place: &str) -> Result<Property, TransferImportError> {
    let mut property = Property::default();
    for attribute in element.attributes() {
        let attribute =
            attribute.map_err(|error| TransferImportError::syntax(place, quick_xml::Error::from(error)))?;
        let value = attribute
            .normalized_value(XmlVersion::Implicit1_0)
            .map_err(|error| TransferImportError::syntax(place, error))?
            .into_owned();
        match attribute.key.as_ref() {
            "name" => property.name = Some(value),
            "shade" => property.shade = Some(value),
            "ambient" => property.shares[0] = Some(value),
            "diffuse" => property.shares[1] = Some(value),
            "specular" => property.shares[2] = Some(value),
            "specularPower" => property.specular_power = Some(value),
            "scalarOpacityUnitDistance" => property.unit_mm = Some(value),
            "colorTransfer" => property.color = value,
            "scalarOpacity" => property.opacity = value,
            "gradientOpacity" => property.gradient = Some(value),
            _ => {}
        }
    }
    Ok(property)
}

/// The property of a `.vp` file: nine lines in a fixed order.
pub(super) fn property_in_lines(bytes: &[u8]) -> Result<Draft, TransferImportError> {
    let text = std::str::from_utf8(bytes).map_err(|_| TransferImportError::Unknown)?;
    let mut lines = text.lines().map(str::trim);
    let mut next = |what: &'static str| {
        let missing = || TransferImportError::syntax(".vp", TransferSyntaxError::MissingLine(what));
        lines.next().filter(|line| !line.is_empty()).map(str::to_owned).ok_or_else(missing)
    };
    next("interpolation")?;
    let shade = Some(next("shade")?);
    let [diffuse, ambient, specular] = [next("diffuse")?, next("ambient")?, next("specular")?].map(Some);
    let specular_power = Some(next("specularPower")?);
    let opacity = next("scalarOpacity")?;
    let gradient = Some(next("gradientOpacity")?);
    let color = next("colorTransfer")?;
    let shares = [ambient, diffuse, specular];
    Property { shade, shares, specular_power, color, opacity, gradient, ..Property::default() }.draft()
}

impl Property {
    fn draft(&self) -> Result<Draft, TransferImportError> {
        let name = self.name.as_deref().unwrap_or("volume property");
        let at = |what: &str| format!("{name}: {what}");
        let number = |what: &str, text: Option<&String>, otherwise: f64| match text {
            Some(text) => text
                .trim()
                .parse()
                .map_err(|_| TransferImportError::range(&at(what), &shortened(text), "a number")),
            None => Ok(otherwise),
        };
        let [ambient, diffuse, specular] = &self.shares;
        // A missing property has VTK's default.
        let shares = [
            number("ambient", ambient.as_ref(), 0.1)?,
            number("diffuse", diffuse.as_ref(), 0.7)?,
            number("specular", specular.as_ref(), 0.2)?,
        ];
        let power = number("specularPower", self.specular_power.as_ref(), 10.0)?;
        let is_lit = number("shade", self.shade.as_ref(), 0.0)? != 0.0;
        let gradient = self.gradient.as_ref().map(|text| curve(text, &at("gradientOpacity"))).transpose()?;
        Ok(Draft {
            name: self.name.clone(),
            color: curve(&self.color, &at("colorTransfer"))?,
            space: ColorSpace::Rgb,
            opacity: curve(&self.opacity, &at("scalarOpacity"))?,
            gradient,
            opacity_unit_mm: number("scalarOpacityUnitDistance", self.unit_mm.as_ref(), 1.0)?,
            light: Some(light(name, is_lit, shares, power)?),
            left_out: Vec::new(),
        })
    }
}

/// A function from its number of values and the values.
fn curve<const N: usize>(text: &str, what: &str) -> Result<Curve<N>, TransferImportError> {
    let mut words = text.split_ascii_whitespace();
    let stated: usize = match words.next().map(str::parse) {
        Some(Ok(stated)) => stated,
        Some(Err(_)) | None => {
            return Err(TransferImportError::range(
                what,
                &shortened(text),
                "the number of values, then the values",
            ));
        }
    };
    let most = (N + 1) * Curve::<N>::MAX_NODES;
    if stated > most || !stated.is_multiple_of(N + 1) {
        let allowed = format!("a multiple of {} up to {most}", N + 1);
        return Err(TransferImportError::range(&format!("{what}: number of values"), &stated, &allowed));
    }
    let values: Vec<f64> = words
        .by_ref()
        .take(stated)
        .map(|word| word.parse().map_err(|_| TransferImportError::range(what, &shortened(word), "numbers")))
        .collect::<Result<_, _>>()?;
    if values.len() < stated || words.next().is_some() {
        let found = if values.len() < stated { values.len().to_string() } else { "more".to_owned() };
        return Err(TransferImportError::range(
            &format!("{what}: values"),
            &found,
            &format!("{stated}, as it says"),
        ));
    }
    let node = |point: &[f64]| Node::plain(point[0], std::array::from_fn(|c| point[1 + c]));
    Curve::new(values.chunks_exact(N + 1).map(node).collect(), CoincidentNodes::Step, what)
}

/// As much of a text as an error needs.
pub(super) fn shortened(text: &str) -> String {
    let cut: String = text.chars().take(40).collect();
    format!("{cut:?}")
}
