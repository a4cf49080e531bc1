//! Circles of imports: modules of a crate that import each other, directly or through others.
//!
//! A module is a file. An import counts for the module that defines the item, whatever facade
//! exports it again. Tests and the insides of macros do not count.

use std::collections::{BTreeMap, BTreeSet};

use syn::visit::{self, Visit};

use super::File;

/// The path of a module in its crate; the crate's root is empty.
type Module = Vec<String>;

/// Circles of a facade and one of its files: they are short, and more of them are not needed.
const MOST_PAIRS: usize = 8;

/// Complains of circles that are larger than a facade and one of its files, and of too many of
/// those.
pub(super) fn imports_make_no_circles(files: &[File]) -> Vec<String> {
    let mut crates: BTreeMap<&str, BTreeMap<Module, Imports>> = BTreeMap::new();
    for file in files {
        let Some((name, module)) = module_of(&file.path) else { continue };
        match syn::parse_file(&file.text) {
            Ok(parsed) => crates.entry(name).or_default().insert(module, Imports::of(&parsed)),
            Err(error) => return vec![format!("{}: {error}", file.path)],
        };
    }
    let (mut found, mut pairs) = (Vec::new(), Vec::new());
    for (name, modules) in &crates {
        for circle in circles(&edges(modules)) {
            let list: Vec<String> = circle.iter().map(|module| module.join("::")).collect();
            let is_pair = circle.len() == 2 && circle[1].starts_with(&circle[0]);
            let circle = format!("{name}: {}", list.join(", "));
            if is_pair { pairs.push(circle) } else { found.push(format!("import each other in {circle}")) }
        }
    }
    if pairs.len() > MOST_PAIRS {
        found.push(format!("facades import their files and are imported by them: {}", pairs.join("; ")));
    }
    found
}

/// The crate and the module of a file below `src`; `None` for other files and for tests.
fn module_of(path: &str) -> Option<(&str, Module)> {
    let (name, rest) = path.strip_prefix("src/")?.strip_suffix(".rs")?.split_once('/')?;
    let mut module: Module = rest.split('/').map(str::to_owned).collect();
    if matches!(module.last().map(String::as_str), Some("mod" | "lib")) {
        module.pop();
    }
    (!module.iter().any(|part| part == "tests")).then_some((name, module))
}

/// The paths that a file names.
#[derive(Default)]
struct Imports {
    /// Paths as written, without `super` of modules inside the file.
    paths: Vec<Vec<String>>,
    /// The paths that `use` names in this file.
    names: BTreeMap<String, Vec<String>>,
    /// Items that it exports again, and modules all of whose items it does.
    exported: BTreeMap<String, Vec<String>>,
    globs: Vec<Vec<String>>,
    /// Items that it defines.
    defined: BTreeSet<String>,
    /// Modules inside the file around the visited item.
    depth: usize,
}

impl Imports {
    fn of(file: &syn::File) -> Self {
        let mut imports = Self::default();
        imports.visit_file(file);
        imports
    }

    /// A path as the file itself would write it; `None` where it stays inside the file.
    fn outward(&self, path: Vec<String>) -> Option<Vec<String>> {
        let supers = path.iter().take_while(|part| *part == "super").count();
        if self.depth == 0 || path.first().is_some_and(|first| first == "crate") {
            return Some(path);
        }
        (supers > self.depth).then(|| path[self.depth..].to_vec())
    }

    fn flatten(&mut self, tree: &syn::UseTree, before: &[String], is_exported: bool) {
        let joined = |name: &syn::Ident| [before, &[name.to_string()]].concat();
        match tree {
            syn::UseTree::Path(path) => self.flatten(&path.tree, &joined(&path.ident), is_exported),
            syn::UseTree::Group(group) => {
                group.items.iter().for_each(|tree| self.flatten(tree, before, is_exported));
            }
            syn::UseTree::Glob(_) if is_exported => self.globs.push(before.to_vec()),
            syn::UseTree::Glob(_) => self.paths.extend(self.outward(before.to_vec())),
            syn::UseTree::Name(name) if name.ident == "self" => {
                self.name(before.last().cloned().unwrap_or_default(), before.to_vec(), is_exported);
            }
            syn::UseTree::Name(name) => {
                self.name(name.ident.to_string(), joined(&name.ident), is_exported);
            }
            syn::UseTree::Rename(name) => {
                self.name(name.rename.to_string(), joined(&name.ident), is_exported);
            }
        }
    }

    fn name(&mut self, name: String, path: Vec<String>, is_exported: bool) {
        let Some(path) = self.outward(path) else { return };
        if is_exported && self.depth == 0 {
            self.exported.insert(name, path);
        } else {
            self.names.insert(name, path.clone());
            self.paths.push(path);
        }
    }
}

fn is_test(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("cfg") && attribute.parse_args::<syn::Ident>().is_ok_and(|on| on == "test")
    })
}

impl<'ast> Visit<'ast> for Imports {
    fn visit_item(&mut self, item: &'ast syn::Item) {
        let name = match item {
            syn::Item::Const(item) => Some(&item.ident),
            syn::Item::Enum(item) => Some(&item.ident),
            syn::Item::Fn(item) => Some(&item.sig.ident),
            syn::Item::Static(item) => Some(&item.ident),
            syn::Item::Struct(item) => Some(&item.ident),
            syn::Item::Trait(item) => Some(&item.ident),
            syn::Item::Type(item) => Some(&item.ident),
            _ => None,
        };
        if self.depth == 0 {
            self.defined.extend(name.map(ToString::to_string));
        }
        visit::visit_item(self, item);
    }

    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        if !is_test(&item.attrs) && item.content.is_some() {
            self.depth += 1;
            visit::visit_item_mod(self, item);
            self.depth -= 1;
        }
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        if !is_test(&item.attrs) {
            self.flatten(&item.tree, &[], !matches!(item.vis, syn::Visibility::Inherited));
        }
    }

    fn visit_vis_restricted(&mut self, _: &'ast syn::VisRestricted) {
        // `pub(in super::super)` imports nothing.
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let parts: Vec<String> = path.segments.iter().map(|part| part.ident.to_string()).collect();
        if parts.len() > 1 {
            self.paths.extend(self.outward(parts));
        }
        visit::visit_path(self, path);
    }
}

type Modules = BTreeMap<Module, Imports>;

/// A path seen from a module, from the crate's root; `None` for other crates.
fn absolute(modules: &Modules, module: &Module, path: &[String]) -> Option<Module> {
    let supers = path.iter().take_while(|part| *part == "super").count();
    match path.first().map(String::as_str) {
        Some("crate") => Some(path[1..].to_vec()),
        Some("self") => Some([module, &path[1..]].concat()),
        Some("super") => Some([module.get(..module.len().checked_sub(supers)?)?, &path[supers..]].concat()),
        Some(first) => {
            let own = [module.as_slice(), &[first.to_owned()]].concat();
            modules.contains_key(&own).then(|| [module, path].concat())
        }
        None => None,
    }
}

/// The module that defines what an absolute path names.
fn definer(modules: &Modules, path: &[String], steps: usize) -> Option<Module> {
    let length = (0..=path.len()).rev().find(|&length| modules.contains_key(&path[..length]))?;
    let (module, rest) = (path[..length].to_vec(), &path[length..]);
    let (Some(name), true) = (rest.first(), steps > 0) else { return Some(module) };
    let imports = &modules[&module];
    if let Some(target) = imports.exported.get(name) {
        let target = absolute(modules, &module, target)?;
        return definer(modules, &[&target, &rest[1..]].concat(), steps - 1);
    }
    let globs = imports.globs.iter().filter_map(|glob| absolute(modules, &module, glob));
    let from_glob =
        globs.into_iter().find(|glob| modules.get(glob).is_some_and(|of| of.defined.contains(name)));
    Some(from_glob.unwrap_or(module))
}

/// The modules that each module imports.
fn edges(modules: &Modules) -> BTreeMap<&Module, BTreeSet<Module>> {
    let imported = |module: &Module, imports: &Imports| {
        let of_path = |path: &Vec<String>| {
            // A path may begin with a module that `use` has brought in.
            let begun = path.first().and_then(|first| imports.names.get(first));
            let whole = begun.map_or_else(|| path.clone(), |begun| [begun, &path[1..]].concat());
            definer(modules, &absolute(modules, module, &whole)?, 10).filter(|found| found != module)
        };
        imports.paths.iter().filter_map(of_path).collect()
    };
    modules.iter().map(|(module, imports)| (module, imported(module, imports))).collect()
}

/// Sets of modules that reach each other, each sorted.
fn circles(edges: &BTreeMap<&Module, BTreeSet<Module>>) -> Vec<Vec<Module>> {
    let reached = |from: &Module| {
        let (mut seen, mut next) = (BTreeSet::new(), vec![from.clone()]);
        while let Some(module) = next.pop() {
            let more = edges.get(&module).into_iter().flatten();
            next.extend(more.filter(|module| seen.insert((*module).clone())).cloned());
        }
        seen
    };
    let reach: BTreeMap<&Module, BTreeSet<Module>> =
        edges.keys().map(|module| (*module, reached(module))).collect();
    let circle = |module: &Module| -> Vec<Module> {
        reach[module]
            .iter()
            .filter(|other| reach.get(other).is_some_and(|of| of.contains(module)))
            .cloned()
            .collect()
    };
    let found: BTreeSet<Vec<Module>> = edges.keys().map(|module| circle(module)).collect();
    found.into_iter().filter(|circle| circle.len() > 1).collect()
}
