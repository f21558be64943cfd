//! Makes the command-line flags from the tables of settings, and reads their values into an [`Experiment`].

use std::marker::PhantomData;

use clap::builder::{OsStringValueParser, TypedValueParser};
use clap::error::Error;
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};
use taugate::internals::input::experiment::Experiment;
use taugate::internals::settings::setting::{Form, Setting, Taker, Value, Visitor};
use taugate::internals::settings::table::find;

/// A command with flags for settings.
pub trait Flagged {
    fn has(setting: &Setting) -> bool;
}

#[derive(Debug, Clone)]
pub struct Render;
#[derive(Debug, Clone)]
pub struct Info;
#[derive(Debug, Clone)]
pub struct View;

impl Flagged for Render {
    fn has(_: &Setting) -> bool {
        true
    }
}

impl Flagged for Info {
    fn has(setting: &Setting) -> bool {
        setting.is_for(Taker::Info)
    }
}

impl Flagged for View {
    fn has(setting: &Setting) -> bool {
        setting.is_for(Taker::View)
    }
}

/// The values of the flags of a command.
#[derive(Debug, Clone)]
pub struct Flags<C>(pub Experiment, PhantomData<C>);

impl<C: Flagged> Args for Flags<C> {
    fn augment_args(command: Command) -> Command {
        let mut list = FlagList { args: vec![], has: C::has };
        Experiment::default().visit(&mut list);
        // The help lists the group Diagnostics last.
        list.args.sort_by_key(|arg| arg.get_help_heading() == Some("Diagnostics"));
        command.args(list.args)
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl<C: Flagged> FromArgMatches for Flags<C> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        let mut experiment = Experiment::default();
        experiment.visit(&mut TypedValues { matches });
        Ok(Flags(experiment, PhantomData))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        self.0.visit(&mut TypedValues { matches });
        Ok(())
    }
}

/// Makes one flag per setting that the command has.
struct FlagList {
    args: Vec<Arg>,
    has: fn(&Setting) -> bool,
}

impl Visitor for FlagList {
    fn visit<T: Value>(&mut self, setting: &'static Setting, _: &mut Option<T>) {
        if !(self.has)(setting) {
            return;
        }
        let mut arg = Arg::new(setting.name)
            .long(setting.name)
            .help(setting.help.trim_start())
            .help_heading(setting.heading)
            .value_parser(OsStringValueParser::new().try_map(|word| T::parse(&word)));
        arg = match setting.form {
            Form::Value => arg.value_name(setting.value),
            Form::Signed => arg.value_name(setting.value).allow_hyphen_values(true),
            Form::Repeated => arg.value_name(setting.value).action(ArgAction::Append),
            Form::SignedRepeated => arg.value_name(setting.value).action(ArgAction::Append).allow_hyphen_values(true),
            Form::Switch => arg.num_args(0).default_missing_value("true"),
            Form::Optional { bare, equals } => {
                arg.value_name(setting.value).num_args(0..=1).require_equals(equals).default_missing_value(bare)
            }
        };
        if let Some(letter) = setting.short {
            arg = arg.short(letter);
        }
        // Clap refuses conflicts with flags that the command does not have.
        let excludes = setting.excludes.iter().filter(|other| find(other).is_some_and(self.has));
        self.args.push(arg.conflicts_with_all(excludes));
    }
}

/// Fills settings with the values that the user typed.
struct TypedValues<'m> {
    matches: &'m ArgMatches,
}

impl Visitor for TypedValues<'_> {
    fn visit<T: Value>(&mut self, setting: &'static Setting, slot: &mut Option<T>) {
        // `try_get_many` fails for flags that the command does not have. For a switch that was not typed, clap returns a
        // default value; only values from the command line count.
        let values = self.matches.try_get_many::<T>(setting.name).ok().flatten();
        let values = values.filter(|_| self.matches.value_source(setting.name) == Some(ValueSource::CommandLine));
        *slot = values.into_iter().flatten().cloned().reduce(T::and);
    }
}
