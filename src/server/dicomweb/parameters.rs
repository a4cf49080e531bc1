//! The query of a rendered volume: PS3.18 2024d, sections 8.3.5.1 and 8.3.5.3.
//!
//! Parameters that the standard does not define are ignored, as it requires (8.3.4). Defined
//! parameters that are not supported are refused by name, so that no client misinterprets the
//! answer. Values are case-sensitive, lengths in mm, positions in the volume's frame of reference
//! (patient LPS).

use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};

use crate::problem::Problem;

/// The kind of rendering.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reformat {
    /// `/rendered3D`: a parallel projection.
    ThreeD,
    /// `/renderedmpr`: a slice or slab.
    Mpr,
}

/// `renderingmethod`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Method {
    VolumeRendered,
    Maximum,
    Minimum,
    Average,
}

impl Method {
    const ALL: [Self; 4] = [Self::VolumeRendered, Self::Maximum, Self::Minimum, Self::Average];

    /// Its word in a query; Rendering Method (0070,120D) has the same in capitals.
    pub(super) const fn word(self) -> &'static str {
        match self {
            Self::VolumeRendered => "volume_rendered",
            Self::Maximum => "maximum_ip",
            Self::Minimum => "minimum_ip",
            Self::Average => "average_ip",
        }
    }
}

/// The shape of a window: VOI LUT Function (0028,1056).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum WindowFunction {
    Linear,
    LinearExact,
}

impl WindowFunction {
    /// The word of VOI LUT Function.
    pub(super) const fn function(self) -> &'static str {
        match self {
            Self::Linear => "LINEAR",
            Self::LinearExact => "LINEAR_EXACT",
        }
    }
}

/// `window`: centre and width in HU, and the shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Window {
    pub(super) center: f64,
    pub(super) width: f64,
    pub(super) shape: WindowFunction,
}

/// From where the volume is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum View {
    /// `orientation`: one of `a`, `p`, `r`, `l`, `h`, `f`; `None` if absent.
    Side(Option<char>),
    /// `viewpointposition`, `viewpointlookat` and `viewpointup`, each if present.
    Viewpoint { position: Option<[f64; 3]>, look_at: Option<[f64; 3]>, up: Option<[f64; 3]> },
}

/// A query, read.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Parameters {
    pub(super) method: Option<Method>,
    pub(super) view: View,
    pub(super) slab_mm: Option<f64>,
    pub(super) viewport: Option<[u32; 2]>,
    pub(super) window: Option<Window>,
    pub(super) quality: Option<u8>,
    /// `renderedvolumetricmetadata=yes`.
    pub(super) metadata: bool,
    /// `accept`, for clients that cannot set the header.
    accept: Option<String>,
}

/// Parameters of the standard that are not done, and why.
const NOT_DONE: [(&str, &str); 6] = [
    ("volumeinputreference", "the volume is the whole series"),
    ("swivelrange", "animations are not rendered"),
    ("volumetriccurvepoint", "animations are not rendered"),
    ("animationstepsize", "animations are not rendered"),
    ("animationrate", "animations are not rendered"),
    ("annotation", "nothing is burnt into pictures"),
];

const SIDES: &str = "aprlhf";

/// Largest coordinate of a viewpoint, mm.
const FARTHEST_MM: f64 = 1e5;

impl Parameters {
    /// Reads the query of a request's target.
    ///
    /// # Errors
    /// 400 when a parameter is twofold, malformed, contradicts another or is not done here.
    pub(super) fn of(uri: &Uri, reformat: Reformat) -> Result<Self, Problem> {
        let query = Query::of(uri)?;
        if let Some((name, why)) = NOT_DONE.iter().find(|(name, _)| query.get(name).is_some()) {
            return Err(not_supported(name, why));
        }
        if let Some(profile) = query.get("iccprofile")
            && profile != "no"
        {
            return Err(not_supported("iccprofile", "pictures carry no profile; allowed: no"));
        }
        if reformat == Reformat::ThreeD && query.get("mprslab").is_some() {
            return Err(malformed("mprslab", "given", "only for renderedmpr"));
        }
        let method = query.get("renderingmethod").map(|text| method(text, reformat)).transpose()?;
        let window = query.get("window").map(window).transpose()?;
        let projects = reformat == Reformat::Mpr || method.is_some_and(|m| m != Method::VolumeRendered);
        if window.is_some() && !projects {
            return Err(malformed(
                "window",
                "given",
                "only for maximum_ip, minimum_ip, average_ip and slices",
            ));
        }
        Ok(Self {
            method,
            view: view(&query)?,
            slab_mm: query.get("mprslab").map(slab).transpose()?,
            viewport: query.get("viewport").map(viewport).transpose()?,
            window,
            quality: query.get("quality").map(quality).transpose()?,
            metadata: query.get("renderedvolumetricmetadata").map(metadata).transpose()?.unwrap_or(false),
            accept: query.get("accept").map(str::to_owned),
        })
    }
}

impl Parameters {
    /// The accepted media types: the parameter has precedence over the header (8.3.3.1).
    pub(super) fn accept(&self, headers: &HeaderMap) -> Result<HeaderMap, Problem> {
        let Some(text) = &self.accept else { return Ok(headers.clone()) };
        let value = HeaderValue::from_str(text).map_err(|_| malformed("accept", text, "media types"))?;
        Ok(HeaderMap::from_iter([(header::ACCEPT, value)]))
    }
}

/// Decoded name-value pairs.
struct Query(Vec<(String, String)>);

impl Query {
    fn of(uri: &Uri) -> Result<Self, Problem> {
        let pairs = axum::extract::Query::<Vec<(String, String)>>::try_from_uri(uri)
            .map_err(|error| Problem::new(StatusCode::BAD_REQUEST, "malformed-parameter", error.body_text()))?
            .0;
        for (at, (name, _)) in pairs.iter().enumerate() {
            if KNOWN.contains(&name.as_str()) && pairs[..at].iter().any(|(other, _)| other == name) {
                return Err(malformed(name, "there twice", "once"));
            }
        }
        Ok(Self(pairs))
    }

    fn get(&self, name: &str) -> Option<&str> {
        self.0.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }
}

/// Parameters that are read; what else there is may come as often as it likes.
const KNOWN: [&str; 11] = [
    "accept",
    "renderingmethod",
    "orientation",
    "viewpointposition",
    "viewpointlookat",
    "viewpointup",
    "mprslab",
    "viewport",
    "window",
    "quality",
    "renderedvolumetricmetadata",
];

fn method(text: &str, reformat: Reformat) -> Result<Method, Problem> {
    let found = Method::ALL.into_iter().find(|method| method.word() == text);
    match found {
        Some(Method::VolumeRendered) if reformat == Reformat::Mpr => {
            Err(malformed("renderingmethod", text, "maximum_ip, minimum_ip or average_ip for renderedmpr"))
        }
        Some(method) => Ok(method),
        None => {
            Err(malformed("renderingmethod", text, "volume_rendered, maximum_ip, minimum_ip or average_ip"))
        }
    }
}

fn view(query: &Query) -> Result<View, Problem> {
    let point = |name| query.get(name).map(|text| triple(name, text)).transpose();
    let viewpoint = [point("viewpointposition")?, point("viewpointlookat")?, point("viewpointup")?];
    let side = query.get("orientation").map(side).transpose()?;
    match (side, viewpoint) {
        (side, [None, None, None]) => Ok(View::Side(side)),
        (Some(_), _) => Err(malformed("orientation", "beside a viewpoint", "one of the two")),
        (None, [position, look_at, up]) => Ok(View::Viewpoint { position, look_at, up }),
    }
}

fn side(text: &str) -> Result<char, Problem> {
    let mut letters = text.chars();
    match (letters.next(), letters.next()) {
        (Some(letter), None) if SIDES.contains(letter) => Ok(letter),
        _ => Err(malformed("orientation", text, "a, p, r, l, h or f")),
    }
}

fn triple(name: &'static str, text: &str) -> Result<[f64; 3], Problem> {
    let within = |value: &f64| value.abs() <= FARTHEST_MM;
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|part| part.trim().parse().ok().filter(within)).collect();
    numbers
        .and_then(|numbers| numbers.try_into().ok())
        .ok_or_else(|| malformed(name, text, "x,y,z in mm, each from -100000 to 100000"))
}

fn slab(text: &str) -> Result<f64, Problem> {
    let within = |mm: &f64| (0.0..=relief_render::RenderRequest::MAX_SLAB_MM).contains(mm);
    text.trim().parse().ok().filter(within).ok_or_else(|| malformed("mprslab", text, "0 to 1000 mm"))
}

/// Width and height. The region that `/rendered` may add means nothing for a volume.
fn viewport(text: &str) -> Result<[u32; 2], Problem> {
    let sides: Option<Vec<u32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let sides = sides.and_then(|sides| <[u32; 2]>::try_from(sides).ok());
    let within = |sides: &[u32; 2]| sides.iter().all(|side| (1..=MOST_PX).contains(side));
    sides.filter(within).ok_or_else(|| malformed("viewport", text, "width,height, each 1 to 4096"))
}

/// Largest side of a viewport: [`relief_render::RenderRequest::MAX_PIXELS`] as a square.
const MOST_PX: u32 = 4096;

fn window(text: &str) -> Result<Window, Problem> {
    let allowed = "center,width,shape with a width of 1 to 65536 and the shape linear or linear-exact";
    let refused = || malformed("window", text, allowed);
    let parts: Vec<&str> = text.split(',').map(str::trim).collect();
    let (center, width, shape) = match parts[..] {
        [center, width] => (center, width, WindowFunction::Linear),
        [center, width, "linear"] => (center, width, WindowFunction::Linear),
        [center, width, "linear-exact"] => (center, width, WindowFunction::LinearExact),
        [_, _, "sigmoid"] => return Err(not_supported("window", "the shape sigmoid is not done")),
        _ => return Err(refused()),
    };
    let number = |text: &str| text.parse::<f64>().ok();
    let center = number(center).filter(|hu| hu.abs() <= 32768.0).ok_or_else(refused)?;
    let width = number(width).filter(|hu| (1.0..=65536.0).contains(hu)).ok_or_else(refused)?;
    Ok(Window { center, width, shape })
}

fn quality(text: &str) -> Result<u8, Problem> {
    let within = |percent: &u8| (1..=100).contains(percent);
    text.trim().parse().ok().filter(within).ok_or_else(|| malformed("quality", text, "1 to 100"))
}

fn metadata(text: &str) -> Result<bool, Problem> {
    if text == "yes" { Ok(true) } else { Err(malformed("renderedvolumetricmetadata", text, "yes")) }
}

fn malformed(name: &str, text: &str, allowed: &str) -> Problem {
    let found: String = text.chars().take(60).collect();
    let detail = format!("{name} is {found:?}, allowed: {allowed}");
    Problem::new(StatusCode::BAD_REQUEST, "malformed-parameter", detail)
        .with("path", name)
        .with("found", found)
        .with("allowed", allowed)
}

fn not_supported(name: &str, why: &str) -> Problem {
    let detail = format!("{name} is not supported: {why}");
    Problem::new(StatusCode::BAD_REQUEST, "unsupported-parameter", detail).with("path", name)
}
