//! Shaders and the pipelines that are made of them: one pipeline for each set of constants.
//!
//! A shader has branches for every mode, depth rule and effect. A driver translates, inlines and
//! optimises all of them before it finds that most are dead. So the branches that the constants
//! decide are removed here, and the driver gets the code that can run.

use naga::back::pipeline_constants::process_overrides;
use naga::compact::{KeepUnused, compact};
use naga::valid::ModuleInfo;
use naga::{Block, Expression, Function, Handle, Literal, LocalVariable, Module, Statement};

use super::device::{ErrorScope, Gpu};
use super::error::GpuError;

/// WGSL sources, parsed, with one compute entry point that has the shader's name.
#[derive(Debug)]
pub(crate) struct Shader {
    name: &'static str,
    module: Module,
}

impl Shader {
    /// Parses WGSL sources joined in this order.
    ///
    /// # Errors
    /// When they are not WGSL: a defect of this program.
    pub(crate) fn new(name: &'static str, sources: &[&str]) -> Result<Self, GpuError> {
        let module = naga::front::wgsl::parse_str(&sources.join("\n"));
        let module =
            module.map_err(|error| GpuError::Refused { what: name, source: Box::new(error.into()) })?;
        Ok(Self { name, module })
    }

    /// The pipeline with these values of the shader's `override` constants. The layout follows from
    /// the shader where none is given.
    ///
    /// # Errors
    /// When the driver refuses the pipeline, or has no memory for it.
    pub(crate) fn pipeline(
        &self,
        gpu: &Gpu,
        layout: Option<&wgpu::PipelineLayout>,
        constants: &[(&'static str, f64)],
    ) -> Result<wgpu::ComputePipeline, GpuError> {
        let scope = ErrorScope::open(gpu, self.name);
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(self.name),
            source: wgpu::ShaderSource::Naga(std::borrow::Cow::Owned(self.specialised(constants)?)),
        });
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(self.name),
            layout,
            module: &module,
            entry_point: Some(self.name),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        scope.close()?;
        Ok(pipeline)
    }

    /// The module with these constants, without the branches that they rule out.
    fn specialised(&self, constants: &[(&'static str, f64)]) -> Result<Module, GpuError> {
        let constants = constants.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
        // The information is only handed through: the device validates the module.
        let unused = ModuleInfo::default();
        let processed = process_overrides(&self.module, &unused, None, &constants);
        let (module, _) = processed
            .map_err(|error| GpuError::Refused { what: self.name, source: Box::new(error.into()) })?;
        let mut module = module.into_owned();
        prune(&mut module);
        compact(&mut module, KeepUnused::No);
        Ok(module)
    }
}

/// Removes the branches that constants decide.
fn prune(module: &mut Module) {
    let mut functions = std::mem::take(&mut module.functions);
    for (_, function) in functions.iter_mut() {
        prune_function(module, function);
    }
    module.functions = functions;
    let mut entry_points = std::mem::take(&mut module.entry_points);
    for entry in &mut entry_points {
        prune_function(module, &mut entry.function);
    }
    module.entry_points = entry_points;
}

/// Until nothing more is decided: a branch that is removed can decide a condition of `&&` or `||`.
fn prune_function(module: &Module, function: &mut Function) {
    let mut decided = Vec::new();
    loop {
        let known = Known { module, function, decided: &decided };
        let body = known.pruned(function.body.clone());
        let found = Known { module, function, decided: &decided }.locals(&body);
        function.body = body;
        if found.len() == decided.len() {
            break;
        }
        decided = found;
    }
    // Names would keep items that are no longer used.
    function.named_expressions.clear();
}

/// The conditions of a function that are known before it runs.
struct Known<'a> {
    module: &'a Module,
    function: &'a Function,
    /// Variables of `&&` and `||` that have one value only.
    decided: &'a [(Handle<LocalVariable>, bool)],
}

impl Known<'_> {
    fn condition(&self, expression: Handle<Expression>) -> Option<bool> {
        match self.function.expressions[expression] {
            Expression::Literal(Literal::Bool(value)) => Some(value),
            Expression::Constant(constant) => {
                match self.module.global_expressions[self.module.constants[constant].init] {
                    Expression::Literal(Literal::Bool(value)) => Some(value),
                    _ => None,
                }
            }
            Expression::Unary { op: naga::UnaryOperator::LogicalNot, expr } => {
                self.condition(expr).map(|value| !value)
            }
            Expression::Load { pointer } => {
                let local = self.temporary(pointer)?;
                self.decided.iter().find(|(decided, _)| *decided == local).map(|(_, value)| *value)
            }
            _ => None,
        }
    }

    /// The variable without a name that this points to: those of `&&` and `||` alone have none.
    fn temporary(&self, pointer: Handle<Expression>) -> Option<Handle<LocalVariable>> {
        let Expression::LocalVariable(local) = self.function.expressions[pointer] else { return None };
        let variable = &self.function.local_variables[local];
        (variable.name.is_none() && variable.init.is_none()).then_some(local)
    }

    fn pruned(&self, block: Block) -> Block {
        let mut kept = Block::with_capacity(block.len());
        for (statement, span) in block.span_into_iter() {
            match statement {
                Statement::If { condition, accept, reject } => match self.condition(condition) {
                    Some(true) => kept.extend_block(self.pruned(accept)),
                    Some(false) => kept.extend_block(self.pruned(reject)),
                    None => {
                        let (accept, reject) = (self.pruned(accept), self.pruned(reject));
                        kept.push(Statement::If { condition, accept, reject }, span);
                    }
                },
                Statement::Block(block) => kept.push(Statement::Block(self.pruned(block)), span),
                Statement::Loop { body, continuing, break_if } => {
                    let (body, continuing) = (self.pruned(body), self.pruned(continuing));
                    kept.push(Statement::Loop { body, continuing, break_if }, span);
                }
                Statement::Switch { selector, mut cases } => {
                    for case in &mut cases {
                        case.body = self.pruned(std::mem::take(&mut case.body));
                    }
                    kept.push(Statement::Switch { selector, cases }, span);
                }
                other => kept.push(other, span),
            }
            if kept.last().is_some_and(ends_block) {
                break; // statements behind it would be invalid
            }
        }
        kept
    }

    /// Variables of `&&` and `||` to which one value is stored, and that a known one.
    fn locals(&self, body: &Block) -> Vec<(Handle<LocalVariable>, bool)> {
        let mut stored = Vec::new();
        self.collect_stores(body, &mut stored);
        let is_alone = |local| stored.iter().filter(|(other, _)| *other == local).count() == 1;
        stored
            .iter()
            .filter_map(|&(local, value)| Some((local, value?)).filter(|_| is_alone(local)))
            .collect()
    }

    fn collect_stores(&self, block: &Block, stored: &mut Vec<(Handle<LocalVariable>, Option<bool>)>) {
        for statement in block {
            match statement {
                Statement::Store { pointer, value } => {
                    if let Some(local) = self.temporary(*pointer) {
                        stored.push((local, self.condition(*value)));
                    }
                }
                Statement::If { accept, reject, .. } => {
                    self.collect_stores(accept, stored);
                    self.collect_stores(reject, stored);
                }
                Statement::Block(block) => self.collect_stores(block, stored),
                Statement::Loop { body, continuing, .. } => {
                    self.collect_stores(body, stored);
                    self.collect_stores(continuing, stored);
                }
                Statement::Switch { cases, .. } => {
                    cases.iter().for_each(|case| self.collect_stores(&case.body, stored));
                }
                _ => {}
            }
        }
    }
}

/// Whether nothing can follow a statement in its block.
fn ends_block(statement: &Statement) -> bool {
    matches!(statement, Statement::Return { .. } | Statement::Kill | Statement::Break | Statement::Continue)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A shader in which every kind of branch depends on constants, and one branch on data.
    const BRANCHES: &str = "
        override ON: bool = false;
        override KIND: u32 = 0u;
        @group(0) @binding(0) var<storage, read_write> out: array<u32>;
        fn first() -> u32 { return 1u; }
        fn second() -> u32 { return 2u; }
        fn early() -> u32 {
            if ON {
                return first();
            }
            return second();
        }
        fn either() -> u32 {
            if KIND == 1u || KIND == 2u {
                return 10u;
            }
            return 20u;
        }
        fn on_data(at: u32) -> u32 {
            if ON && out[at] > 5u {
                return 100u;
            }
            return 200u;
        }
        @compute @workgroup_size(1)
        fn branches(@builtin(global_invocation_id) id: vec3<u32>) {
            for (var i = 0u; i < 4u; i++) {
                if KIND == 3u { break; }
                out[id.x] += early() + either() + on_data(id.x);
            }
        }";

    fn specialised(constants: &[(&'static str, f64)]) -> Module {
        let module = Shader::new("branches", &[BRANCHES]).unwrap().specialised(constants).unwrap();
        validated(&module);
        module
    }

    fn validated(module: &Module) {
        use naga::valid::{Capabilities, ValidationFlags, Validator};
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::all());
        validator.validate(module).expect("the module is valid");
    }

    fn functions(module: &Module) -> Vec<&str> {
        module.functions.iter().filter_map(|(_, function)| function.name.as_deref()).collect()
    }

    fn ifs(block: &Block) -> usize {
        block
            .iter()
            .map(|statement| match statement {
                Statement::If { accept, reject, .. } => 1 + ifs(accept) + ifs(reject),
                Statement::Block(block) => ifs(block),
                Statement::Loop { body, continuing, .. } => ifs(body) + ifs(continuing),
                Statement::Switch { cases, .. } => cases.iter().map(|case| ifs(&case.body)).sum(),
                _ => 0,
            })
            .sum()
    }

    fn ifs_of(module: &Module, name: &str) -> usize {
        let named = |(_, function): &(_, &Function)| function.name.as_deref() == Some(name);
        module.functions.iter().find(named).map_or(0, |(_, function)| ifs(&function.body))
    }

    #[test]
    fn functions_that_no_branch_calls_are_gone() {
        let on = specialised(&[("ON", 1.0)]);
        assert!(
            functions(&on).contains(&"first") && !functions(&on).contains(&"second"),
            "{:?}",
            functions(&on)
        );
        let off = specialised(&[("ON", 0.0)]);
        assert!(functions(&off).contains(&"second") && !functions(&off).contains(&"first"));
    }

    #[test]
    fn conditions_of_and_and_or_are_decided() {
        for kind in 0..4 {
            let module = specialised(&[("KIND", f64::from(kind))]);
            assert_eq!(ifs_of(&module, "either"), 0, "{kind}");
        }
        assert_eq!(ifs_of(&specialised(&[("ON", 0.0)]), "on_data"), 0);
        let on = specialised(&[("ON", 1.0)]);
        assert_eq!(ifs_of(&on, "on_data"), 1, "the data decide");
    }

    #[test]
    fn a_loop_ends_where_a_constant_ends_it() {
        let module = specialised(&[("KIND", 3.0)]);
        assert!(functions(&module).is_empty(), "{:?}", functions(&module));
        assert_eq!(functions(&specialised(&[("KIND", 0.0)])).len(), 4);
    }

    #[test]
    fn unknown_constants_and_broken_sources_are_errors() {
        let shader = Shader::new("branches", &[BRANCHES]).unwrap();
        assert!(matches!(
            shader.specialised(&[("OFF", 1.0)]),
            Err(GpuError::Refused { what: "branches", .. })
        ));
        assert!(matches!(Shader::new("broken", &["fn f( {"]), Err(GpuError::Refused { what: "broken", .. })));
    }
}
