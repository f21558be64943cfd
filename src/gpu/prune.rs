//! Removes the branches that a kernel never takes. Their conditions are constant once the override constants have values. A condition
//! may also call a function, such as `is_coated`, whose result is constant: it is always false if `HAS_CLEARCOAT` is false.
//!
//! A driver would remove these branches too, but only after it has parsed and optimised the whole module. On lavapipe, the kernels of
//! the Cornell box take three times as long to compile without this removal, at the start of every render.

use std::collections::HashMap;

use naga::{
    Arena, Block, Constant, Expression, Function, Handle, Literal, LocalVariable, Module, Statement, UnaryOperator,
};

/// Replaces each `if` with a constant condition by the branch that is taken, in all functions of `module`. The module stays valid.
pub fn remove_dead_branches(module: &mut Module) {
    let Module { constants, global_expressions, functions, entry_points, .. } = module;
    let mut globals = Globals { constants, expressions: global_expressions, results: HashMap::new() };
    // In `functions`, each function comes after the functions that it calls.
    for (handle, function) in functions.iter_mut() {
        prune(function, &globals);
        if let Some(result) = result(function, &globals) {
            globals.results.insert(handle, result);
        }
    }
    entry_points.iter_mut().for_each(|entry| prune(&mut entry.function, &globals));
}

/// The constants of a module, and the functions whose result is constant.
struct Globals<'a> {
    constants: &'a Arena<Constant>,
    expressions: &'a Arena<Expression>,
    results: HashMap<Handle<Function>, bool>,
}

/// The result of a function if it is a constant.
fn result(function: &Function, globals: &Globals) -> Option<bool> {
    let mut returned = vec![];
    visit(&function.body, &mut |statement| {
        if let Statement::Return { value } = *statement {
            returned.push(value);
        }
    });
    match returned[..] {
        [Some(only)] => value(only, &function.expressions, &stored_once(function), globals),
        _ => None,
    }
}

/// The stored value of each variable that has no name and exactly one store. For `a && b`, naga makes a variable without a
/// name, and an `if` with a store in each branch. Pruning may leave one of these stores.
type Stored = HashMap<Handle<LocalVariable>, Handle<Expression>>;

fn prune(function: &mut Function, globals: &Globals) {
    // A name would keep an expression alive after its statement is removed.
    function.named_expressions.clear();
    loop {
        let stored = stored_once(function);
        let known = |condition| value(condition, &function.expressions, &stored, globals);
        let body = std::mem::take(&mut function.body);
        let mut changed = false;
        function.body = pruned(body, &known, &mut changed);
        if !changed {
            break;
        }
    }
}

/// The value of a condition if it is constant.
fn value(
    condition: Handle<Expression>,
    expressions: &Arena<Expression>,
    stored: &Stored,
    globals: &Globals,
) -> Option<bool> {
    match expressions[condition] {
        Expression::Literal(Literal::Bool(value)) => Some(value),
        Expression::Constant(constant) => match globals.expressions[globals.constants[constant].init] {
            Expression::Literal(Literal::Bool(value)) => Some(value),
            _ => None,
        },
        Expression::Unary { op: UnaryOperator::LogicalNot, expr } => Some(!value(expr, expressions, stored, globals)?),
        Expression::CallResult(function) => globals.results.get(&function).copied(),
        Expression::Load { pointer } => match expressions[pointer] {
            Expression::LocalVariable(variable) => value(*stored.get(&variable)?, expressions, stored, globals),
            _ => None,
        },
        _ => None,
    }
}

/// Finds the variables of [`Stored`].
fn stored_once(function: &Function) -> Stored {
    let mut stores: HashMap<Handle<LocalVariable>, Vec<Handle<Expression>>> = HashMap::new();
    visit(&function.body, &mut |statement| {
        if let Statement::Store { pointer, value } = *statement
            && let Expression::LocalVariable(variable) = function.expressions[pointer]
            && function.local_variables[variable].name.is_none()
        {
            stores.entry(variable).or_default().push(value);
        }
    });
    stores
        .into_iter()
        .filter_map(|(variable, values)| Some((variable, *values.first().filter(|_| values.len() == 1)?)))
        .collect()
}

/// Calls `see` for each statement of `block` and of the blocks in it.
fn visit(block: &Block, see: &mut impl FnMut(&Statement)) {
    for statement in block.iter() {
        see(statement);
        match statement {
            Statement::Block(block) => visit(block, see),
            Statement::If { accept, reject, .. } => {
                visit(accept, see);
                visit(reject, see);
            }
            Statement::Switch { cases, .. } => cases.iter().for_each(|case| visit(&case.body, see)),
            Statement::Loop { body, continuing, .. } => {
                visit(body, see);
                visit(continuing, see);
            }
            _ => {}
        }
    }
}

/// `block` without the branches that are not taken, and without the statements after a statement that leaves the block.
fn pruned(block: Block, known: &impl Fn(Handle<Expression>) -> Option<bool>, changed: &mut bool) -> Block {
    let mut out = Block::with_capacity(block.len());
    for (statement, span) in block.span_into_iter() {
        match statement {
            Statement::If { condition, accept, reject } => match known(condition) {
                Some(taken) => {
                    *changed = true;
                    out.extend_block(pruned(if taken { accept } else { reject }, known, changed));
                }
                None => {
                    let (accept, reject) = (pruned(accept, known, changed), pruned(reject, known, changed));
                    out.push(Statement::If { condition, accept, reject }, span);
                }
            },
            Statement::Block(inner) => out.push(Statement::Block(pruned(inner, known, changed)), span),
            Statement::Switch { selector, mut cases } => {
                for case in &mut cases {
                    case.body = pruned(std::mem::take(&mut case.body), known, changed);
                }
                out.push(Statement::Switch { selector, cases }, span);
            }
            Statement::Loop { body, continuing, break_if } => {
                let (body, continuing) = (pruned(body, known, changed), pruned(continuing, known, changed));
                out.push(Statement::Loop { body, continuing, break_if }, span);
            }
            other => out.push(other, span),
        }
        if out.last().is_some_and(Statement::is_terminator) {
            break;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use naga::valid::{Capabilities, ValidationFlags, Validator};

    use super::*;

    /// Number of `if`s and of functions in the shader `text` after pruning. Fails if the shader is not valid after that.
    fn left(text: &str) -> (usize, usize) {
        let mut module = naga::front::wgsl::parse_str(text).unwrap();
        remove_dead_branches(&mut module);
        naga::compact::compact(&mut module, naga::compact::KeepUnused::No);
        Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module).unwrap();
        let mut ifs = 0;
        let mut count = |statement: &Statement| ifs += usize::from(matches!(statement, Statement::If { .. }));
        module.functions.iter().for_each(|(_, function)| visit(&function.body, &mut count));
        module.entry_points.iter().for_each(|entry| visit(&entry.function.body, &mut count));
        (ifs, module.functions.len())
    }

    /// A shader whose function `f(x: u32) -> u32` has this `body`, which may call the functions `on` and `off`.
    fn shader(body: &str) -> String {
        format!(
            "const ON = true; const OFF = false;
            @group(0) @binding(0) var<storage, read_write> word: u32;
            fn on(x: u32) -> u32 {{ return x * 2u; }}
            fn off(x: u32) -> u32 {{ return x * 3u; }}
            fn f(x: u32) -> u32 {{ {body} }}
            @compute @workgroup_size(1) fn main() {{ word = f(word); }}"
        )
    }

    #[test]
    fn branches_that_constants_exclude_are_gone() {
        for body in [
            "if (OFF) { return off(x); } return on(x);",
            "if (!OFF) { return on(x); } else { return off(x); }",
            // The rest of a block is unreachable.
            "if (ON) { return on(x); } let y = off(x); return y;",
            "if (OFF && x > 3u) { return off(x); } return on(x);",
            "if (!(ON || x > 3u)) { let y = off(x); return y; } return on(x);",
            "let both = ON && OFF; if (both && x > 3u) { return off(x); } return on(x);",
            "var y = on(x); for (var i = 0u; i < 4u; i++) { switch i { case 1u: { if (OFF) { y = off(y); } } default: {} } } return y;",
        ] {
            let loops = usize::from(body.contains("for"));
            assert_eq!(left(&shader(body)), (loops, 2), "{body}");
        }
    }

    #[test]
    fn branches_that_a_call_excludes_are_gone() {
        let text = |helper: &str| {
            let both = shader("if (is_on(x) && x < 9u) { return on(x); } return off(x);");
            format!("fn is_on(x: u32) -> bool {{ {helper} }} {both}")
        };
        // `is_on`, `off`, and `f` are left.
        assert_eq!(left(&text("return OFF && x > 3u;")), (0, 3));
        assert_eq!(left(&text("if (ON) { return false; } return x > 3u;")), (0, 3));
        assert_eq!(left(&text("return ON && x > 3u;")), (2, 4));
        assert_eq!(left(&text("if (x > 3u) { return OFF; } return OFF;")), (3, 4), "two returns are too many");
    }

    #[test]
    fn other_branches_stay() {
        assert_eq!(left(&shader("if (x > 3u) { return on(x); } return off(x);")), (1, 3));
        assert_eq!(left(&shader("if (ON && x > 3u) { return on(x); } return off(x);")), (1, 3));
        // The condition of `&&` needs an `if` of its own.
        assert_eq!(left(&shader("if (x > 3u && x < 9u) { return on(x); } return off(x);")), (2, 3));
        // A variable with a name may change.
        assert_eq!(
            left(&shader("var y = OFF; if (x > 3u) { y = ON; } if (y) { return on(x); } return off(x);")),
            (2, 3)
        );
    }
}
