//! MITK's point sets, `.mps`: XML of numbered points without names, in world mm (LPS, as ITK has
//! it).
//!
//! Points are stored in the axes of their `Geometry3D`, which places them in the world; files
//! without one are in world mm. Of a set that changes in time, the first step is read.

use std::collections::HashSet;
use std::fmt::Write;

use glam::{DMat3, DVec3};
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

use super::reading::{self, Reading, point};
use super::{ExchangeError, Format, Imported, ReadContext, SyntaxError};
use relief_annotation::{Geometry, Item};

const FORMAT: Format = Format::Mps;
/// MITK's own files have six levels.
const DEEPEST: usize = 32;

/// A point as far as it is read.
#[derive(Default)]
struct Draft {
    line: usize,
    id: Option<u64>,
    xyz: [Option<f64>; 3],
}

/// Where the parser is.
struct State<'a, 'c> {
    reading: &'a mut Reading<'c>,
    /// Names of the elements that are open.
    open: Vec<String>,
    text: String,
    draft: Draft,
    /// Points of the time step, in its own axes.
    points: Vec<(usize, u64, DVec3)>,
    world_from_own: (DMat3, DVec3),
    sets: usize,
    steps: usize,
}

/// Reads a point set.
///
/// # Errors
/// As [`super::read`]; places are lines.
pub(super) fn read(bytes: &[u8], context: &ReadContext<'_>) -> Result<Imported, ExchangeError> {
    let text = reading::text(FORMAT, bytes)?;
    let mut reading = Reading::new(FORMAT, context);
    let mut state = State {
        reading: &mut reading,
        open: Vec::new(),
        text: String::new(),
        draft: Draft::default(),
        points: Vec::new(),
        world_from_own: (DMat3::IDENTITY, DVec3::ZERO),
        sets: 0,
        steps: 0,
    };
    let mut reader = Reader::from_str(text);
    let mut line = Lines { text, at: 0, line: 1 };
    loop {
        let event = reader.read_event();
        let at = line.at(usize::try_from(reader.buffer_position()).unwrap_or(usize::MAX));
        let event = event.map_err(|error| syntax(at, error))?;
        match event {
            Event::Start(element) => state.start(at, &element)?,
            Event::Empty(element) => {
                state.start(at, &element)?;
                state.end(at)?;
            }
            Event::End(_) => state.end(at)?,
            Event::Text(words) => state.text.push_str(words.as_ref()),
            Event::CData(_) | Event::GeneralRef(_) if state.is_in_point() => {
                return Err(syntax(at, SyntaxError::MarkedNumber));
            }
            Event::Eof if state.open.is_empty() && state.sets > 0 => break,
            Event::Eof => {
                let open = state.open.last().map_or("point_set", String::as_str);
                return Err(syntax(at, SyntaxError::Unclosed(open.to_owned())));
            }
            _ => {}
        }
    }
    Ok(reading.finish())
}

fn syntax(line: usize, source: impl Into<SyntaxError>) -> ExchangeError {
    ExchangeError::Syntax { format: FORMAT, place: format!("line {line}"), source: source.into() }
}

/// Lines of growing places in a text.
struct Lines<'a> {
    text: &'a str,
    at: usize,
    line: usize,
}

impl Lines<'_> {
    fn at(&mut self, byte: usize) -> usize {
        let end = byte.min(self.text.len()).max(self.at);
        self.line += self.text.as_bytes()[self.at..end].iter().filter(|byte| **byte == b'\n').count();
        self.at = end;
        self.line
    }
}

impl State<'_, '_> {
    fn is_in_point(&self) -> bool {
        self.open.iter().any(|name| name == "point")
    }

    fn start(&mut self, line: usize, element: &BytesStart<'_>) -> Result<(), ExchangeError> {
        let name = element.name().as_ref().to_owned();
        if self.open.len() == DEEPEST {
            return Err(syntax(line, SyntaxError::TooDeep(DEEPEST)));
        }
        if self.open.is_empty() && name != "point_set_file" {
            return Err(ExchangeError::value(
                FORMAT,
                format!("line {line}"),
                format!("<{name}>"),
                "<point_set_file>",
            ));
        }
        self.text.clear();
        match name.as_str() {
            "point_set" => {
                self.sets += 1;
                self.steps = 0;
            }
            "point" => self.draft = Draft { line, ..Draft::default() },
            "IndexToWorld" => {
                let value =
                    |row: usize, column: usize| attribute(line, element, &format!("m_{row}_{column}"));
                let column = |c| Ok::<_, ExchangeError>(DVec3::new(value(0, c)?, value(1, c)?, value(2, c)?));
                self.world_from_own.0 = DMat3::from_cols(column(0)?, column(1)?, column(2)?);
            }
            "Offset" => {
                let value = |name| attribute(line, element, name);
                self.world_from_own.1 = DVec3::new(value("x")?, value("y")?, value("z")?);
            }
            _ => {}
        }
        self.open.push(name);
        Ok(())
    }

    fn end(&mut self, line: usize) -> Result<(), ExchangeError> {
        let Some(name) = self.open.pop() else { return Ok(()) };
        let axis = ["x", "y", "z"].into_iter().position(|axis| axis == name);
        let is_of_point = self.open.last().is_some_and(|parent| parent == "point");
        match (name.as_str(), axis) {
            (_, Some(axis)) if is_of_point => {
                let number = self.text.trim().parse().ok().filter(|mm: &f64| mm.is_finite());
                self.draft.xyz[axis] = Some(number.ok_or_else(|| self.bad(line, &name, "a finite number"))?);
            }
            ("id", _) if is_of_point => {
                let id = self.text.trim().parse().ok();
                self.draft.id = Some(id.ok_or_else(|| self.bad(line, &name, "a whole number"))?);
            }
            ("point", _) => self.end_point()?,
            // The first versions have points in the set itself.
            ("time_series" | "point_set", _) => self.end_step()?,
            _ => {}
        }
        self.text.clear();
        Ok(())
    }

    fn bad(&self, line: usize, name: &str, allowed: &str) -> ExchangeError {
        ExchangeError::value(
            FORMAT,
            format!("line {line}, <{name}>"),
            format!("{:?}", self.text.trim()),
            allowed,
        )
    }

    fn end_point(&mut self) -> Result<(), ExchangeError> {
        let Draft { line, id, xyz } = std::mem::take(&mut self.draft);
        match (id, xyz) {
            (Some(id), [Some(x), Some(y), Some(z)]) => self.points.push((line, id, DVec3::new(x, y, z))),
            _ => {
                let place = format!("line {line}, <point>");
                return Err(ExchangeError::value(FORMAT, place, "not whole", "one with id, x, y and z"));
            }
        }
        Ok(())
    }

    /// The points of a step of time are items, if it is the first.
    fn end_step(&mut self) -> Result<(), ExchangeError> {
        let points = std::mem::take(&mut self.points);
        let (turn, shift) = std::mem::replace(&mut self.world_from_own, (DMat3::IDENTITY, DVec3::ZERO));
        let Some(&(line, ..)) = points.first() else { return Ok(()) };
        self.steps += 1;
        if self.steps > 1 {
            self.reading.warn(&format!("line {line}"), "a later step of time is left out");
            return Ok(());
        }
        let mut ids = HashSet::new();
        for (line, id, own) in points {
            if !ids.insert(id) {
                return Err(ExchangeError::value(FORMAT, format!("line {line}, <id>"), id, "each id once"));
            }
            let at_mm = point((turn * own + shift).to_array());
            let name = format!("{}-{id}", self.reading.context.list);
            let mut item = self.reading.item(&name, Some(Geometry::Point { at_mm }))?;
            if self.sets > 1 {
                item.list = format!("{}-{}", item.list, self.sets);
            }
            self.reading.push(&format!("line {line}, <point>"), item)?;
        }
        Ok(())
    }
}

fn attribute(line: usize, element: &BytesStart<'_>, name: &str) -> Result<f64, ExchangeError> {
    let value = element
        .attributes()
        .filter_map(Result::ok)
        .find(|attribute| attribute.key.as_ref() == name)
        .and_then(|attribute| attribute.normalized_value(XmlVersion::Implicit1_0).ok()?.trim().parse().ok())
        .filter(|value: &f64| value.is_finite());
    value.ok_or_else(|| {
        let place = format!("line {line}, <{}>, {name}", element.name().as_ref());
        ExchangeError::value(FORMAT, place, "no finite number", "a finite number")
    })
}

/// Writes points, numbered from 0.
///
/// # Errors
/// None; every format may have some.
pub(super) fn write(items: &[&Item]) -> Result<Vec<u8>, ExchangeError> {
    let points: Vec<DVec3> = items.iter().filter_map(|item| item.point()).map(|at| at.xyz).collect();
    let low = points.iter().copied().reduce(DVec3::min).unwrap_or_default();
    let high = points.iter().copied().reduce(DVec3::max).unwrap_or_default();
    let vector = |name: &str, v: DVec3| {
        format!("<{name} type=\"Vector3D\" x=\"{}\" y=\"{}\" z=\"{}\"/>", v.x, v.y, v.z)
    };
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<point_set_file>\n  <file_version>0.1</file_version>\n  <point_set>\n\
         \x20   <time_series>\n      <time_series_id>0</time_series_id>\n\
         \x20     <Geometry3D ImageGeometry=\"false\" FrameOfReferenceID=\"0\">\n\
         \x20       <IndexToWorld type=\"Matrix3x3\" m_0_0=\"1\" m_0_1=\"0\" m_0_2=\"0\" m_1_0=\"0\" m_1_1=\"1\" m_1_2=\"0\" \
         m_2_0=\"0\" m_2_1=\"0\" m_2_2=\"1\"/>\n        {}\n        <Bounds>\n          {}\n          {}\n\
         \x20       </Bounds>\n      </Geometry3D>\n",
        vector("Offset", DVec3::ZERO),
        vector("Min", low),
        vector("Max", high),
    );
    for (id, at) in points.iter().enumerate() {
        let _ = writeln!(
            text,
            "      <point>\n        <id>{id}</id>\n        <specification>0</specification>\n        <x>{}</x>\n\
             \x20       <y>{}</y>\n        <z>{}</z>\n      </point>",
            at.x, at.y, at.z
        );
    }
    text += "    </time_series>\n  </point_set>\n</point_set_file>\n";
    Ok(text.into_bytes())
}
