//! Index checks for debugging. A kernel compares every computed index with the length of the buffer, texel buffer or local array.
//! If an index is too large, the kernel stores the number of its place in the source. (naga's policy `ReadZeroSkipWrite` makes an
//! access out of range harmless, but does not report it.)

use std::collections::HashMap;

use naga::{
    AddressSpace, ArraySize, BinaryOperator, Block, Expression, Function, GlobalVariable, Handle, ImageQuery, Literal,
    Module, ResourceBinding, Scalar, ScalarKind, Span, Statement, StorageAccess, Type, TypeInner, valid,
};

/// Name of the storage variable (one u32) that holds the number of a place whose index was out of range; 0 if there is none.
pub const VIOLATION: &str = "violation";
/// Bind group of [`VIOLATION`]; no kernel uses this group otherwise.
const GROUP: u32 = 3;

/// Whether `TAUGATE_BOUNDS_CHECKS` is set, which adds the checks to every kernel. Images are the same bits with and without
/// checks; a test compares them.
pub fn checked() -> bool {
    std::env::var_os("TAUGATE_BOUNDS_CHECKS").is_some()
}

/// Adds the checks to `module`; `info` is the validator's analysis of `module`. Returns the result of `describe` for each place
/// that is checked; place number 1 comes first.
pub fn instrument(module: &mut Module, info: &valid::ModuleInfo, describe: impl Fn(Span) -> String) -> Vec<String> {
    let word = Type { name: None, inner: TypeInner::Scalar(Scalar::U32) };
    let ty = module.types.insert(word, Span::UNDEFINED);
    let variable = GlobalVariable {
        name: Some(VIOLATION.into()),
        space: AddressSpace::Storage { access: StorageAccess::LOAD | StorageAccess::STORE },
        binding: Some(ResourceBinding { group: GROUP, binding: 0 }),
        ty,
        init: None,
        memory_decorations: Default::default(),
    };
    let violation = module.global_variables.append(variable, Span::UNDEFINED);
    let mut places = vec![];
    let mut functions = std::mem::take(&mut module.functions);
    for (handle, function) in functions.iter_mut() {
        guard_function(module, &info[handle], function, violation, &mut places, &describe);
    }
    module.functions = functions;
    let mut entries = std::mem::take(&mut module.entry_points);
    for (i, entry) in entries.iter_mut().enumerate() {
        guard_function(module, info.get_entry_point(i), &mut entry.function, violation, &mut places, &describe);
    }
    module.entry_points = entries;
    places
}

fn guard_function(
    module: &Module,
    info: &valid::FunctionInfo,
    function: &mut Function,
    violation: Handle<GlobalVariable>,
    places: &mut Vec<String>,
    describe: &impl Fn(Span) -> String,
) {
    let accesses: Vec<_> = function
        .expressions
        .iter()
        .filter_map(|(handle, expression)| Some((handle, indexed(module, info, expression)?)))
        .collect();
    let mut guards = HashMap::new();
    for (handle, (index, length)) in accesses {
        places.push(describe(function.expressions.get_span(handle)));
        let signed = info[index].ty.inner_with(&module.types).scalar_kind() == Some(ScalarKind::Sint);
        let number = places.len() as u32;
        guards.insert(handle, guard(function, index, signed, length, violation, number));
    }
    let body = std::mem::take(&mut function.body);
    function.body = with_guards(body, &mut guards);
}

/// Index and length of an access with a computed index. `None` for a constant index: naga checks constant indices when it parses.
fn indexed(
    module: &Module,
    info: &valid::FunctionInfo,
    expression: &Expression,
) -> Option<(Handle<Expression>, Expression)> {
    match *expression {
        Expression::Access { base, index } => {
            let inner = info[base].ty.inner_with(&module.types);
            let inner = match *inner {
                TypeInner::Pointer { base, .. } => &module.types[base].inner,
                _ => inner,
            };
            match *inner {
                TypeInner::Array { size: ArraySize::Constant(n), .. } => {
                    Some((index, Expression::Literal(Literal::U32(n.get()))))
                }
                TypeInner::Array { size: ArraySize::Dynamic, .. } => Some((index, Expression::ArrayLength(base))),
                _ => None,
            }
        }
        Expression::ImageLoad { image, coordinate, .. } => {
            Some((coordinate, Expression::ImageQuery { image, query: ImageQuery::Size { level: None } }))
        }
        _ => None,
    }
}

/// Statements for `if (index >= length) { violation = number; }`.
fn guard(
    function: &mut Function,
    index: Handle<Expression>,
    signed: bool,
    length: Expression,
    violation: Handle<GlobalVariable>,
    number: u32,
) -> Vec<Statement> {
    let mut add = |expression: Expression| function.expressions.append(expression, Span::UNDEFINED);
    let pointer = add(Expression::GlobalVariable(violation));
    let value = add(Expression::Literal(Literal::U32(number)));
    let constant = matches!(length, Expression::Literal(_)).then(|| add(length.clone()));
    let first = function.expressions.len();
    let mut add = |expression: Expression| function.expressions.append(expression, Span::UNDEFINED);
    let right = constant.unwrap_or_else(|| add(length));
    // As an unsigned number, a negative index is a large one.
    let left = if signed { add(Expression::As { expr: index, kind: ScalarKind::Uint, convert: None }) } else { index };
    let condition = add(Expression::Binary { op: BinaryOperator::GreaterEqual, left, right });
    let range = function.expressions.range_from(first);
    let note = Block::from_vec(vec![Statement::Store { pointer, value }]);
    vec![Statement::Emit(range), Statement::If { condition, accept: note, reject: Block::new() }]
}

/// Copies `block` and inserts each guard after the statement that evaluates the guarded access.
fn with_guards(block: Block, guards: &mut HashMap<Handle<Expression>, Vec<Statement>>) -> Block {
    let mut out = Block::new();
    for (statement, span) in block.span_into_iter() {
        let (statement, behind) = match statement {
            Statement::Emit(range) => {
                let behind: Vec<_> = range.clone().filter_map(|e| guards.remove(&e)).flatten().collect();
                (Statement::Emit(range), behind)
            }
            Statement::Block(inner) => (Statement::Block(with_guards(inner, guards)), vec![]),
            Statement::If { condition, accept, reject } => {
                let (accept, reject) = (with_guards(accept, guards), with_guards(reject, guards));
                (Statement::If { condition, accept, reject }, vec![])
            }
            Statement::Switch { selector, mut cases } => {
                for case in &mut cases {
                    case.body = with_guards(std::mem::take(&mut case.body), guards);
                }
                (Statement::Switch { selector, cases }, vec![])
            }
            Statement::Loop { body, continuing, break_if } => {
                let (body, continuing) = (with_guards(body, guards), with_guards(continuing, guards));
                (Statement::Loop { body, continuing, break_if }, vec![])
            }
            other => (other, vec![]),
        };
        out.push(statement, span);
        behind.into_iter().for_each(|guard| out.push(guard, span));
    }
    out
}
