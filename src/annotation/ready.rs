//! Templates that come with the program: landmarks that many studies place. A log that has a
//! template of the same name has it in place of these.

use super::template::Template;

/// Name and JSON of each, in the order of lists.
const READY: [(&str, &str); 4] = [
    ("aortic-root", include_str!("ready/aortic-root.json")),
    ("cephalometry", include_str!("ready/cephalometry.json")),
    ("pelvis", include_str!("ready/pelvis.json")),
    ("spine", include_str!("ready/spine.json")),
];

impl Template {
    /// The names of the templates that come with the program.
    pub fn ready_names() -> impl Iterator<Item = &'static str> {
        READY.iter().map(|(name, _)| *name)
    }

    /// The JSON of a template that comes with the program.
    #[must_use]
    pub fn ready_json(name: &str) -> Option<&'static str> {
        READY.iter().find(|(known, _)| *known == name).map(|(_, json)| *json)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ready_templates_are_valid_and_say_how_to_find_each_landmark() {
        for (name, json) in READY {
            let template = Template::read(json.as_bytes()).unwrap();
            assert_eq!(template.name, name);
            assert!(template.items.len() >= 10 && !template.description.is_empty());
            assert!(template.items.iter().all(|item| !item.description.is_empty()), "{name}");
        }
    }
}
