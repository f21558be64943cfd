//! The flags of an experiment: made from the tables of settings, and read back into an experiment.

use clap::builder::{OsStringValueParser, TypedValueParser};
use clap::error::Error;
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};
use taugate::internals::input::experiment::Experiment;
use taugate::internals::settings::setting::{Form, Setting, Value, Visitor};

/// The settings that `taugate info` asks for.
const OF_INFO: [&str; 6] = ["camera", "resolution", "emitters", "max-depth", "light-paths", "device"];

/// What the flags of `taugate render` say or, with `INFO`, those of `taugate info`.
#[derive(Debug, Clone)]
pub struct Flags<const INFO: bool>(pub Experiment);

impl<const INFO: bool> Args for Flags<INFO> {
    fn augment_args(command: Command) -> Command {
        let mut listed = Listed { args: vec![] };
        Experiment::default().visit(&mut listed);
        let asked_for = |arg: &Arg| !INFO || OF_INFO.contains(&arg.get_id().as_str());
        // Diagnostics stand last in the help.
        listed.args.sort_by_key(|arg| arg.get_help_heading() == Some("Diagnostics"));
        command.args(listed.args.into_iter().filter(asked_for))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl<const INFO: bool> FromArgMatches for Flags<INFO> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        let mut experiment = Experiment::default();
        experiment.visit(&mut Typed { matches });
        Ok(Flags(experiment))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        self.0.visit(&mut Typed { matches });
        Ok(())
    }
}

/// Makes a flag of every setting.
struct Listed {
    args: Vec<Arg>,
}

impl Visitor for Listed {
    fn visit<T: Value>(&mut self, setting: &'static Setting, _: &mut Option<T>) {
        let mut arg = Arg::new(setting.name)
            .long(setting.name)
            .help(setting.help.trim_start())
            .help_heading(setting.heading)
            .value_parser(OsStringValueParser::new().try_map(|word| T::parse(&word)));
        arg = match setting.form {
            Form::Value => arg.value_name(setting.value),
            Form::Signed => arg.value_name(setting.value).allow_hyphen_values(true),
            Form::Repeated => arg.value_name(setting.value).action(ArgAction::Append),
            Form::Switch => arg.num_args(0).default_missing_value("true"),
            Form::Optional { bare, equals } => {
                arg.value_name(setting.value).num_args(0..=1).require_equals(equals).default_missing_value(bare)
            }
        };
        if let Some(letter) = setting.short {
            arg = arg.short(letter);
        }
        if let Some(other) = setting.excludes {
            arg = arg.conflicts_with(other);
        }
        self.args.push(arg);
    }
}

/// Fills settings with what was typed.
struct Typed<'m> {
    matches: &'m ArgMatches,
}

impl Visitor for Typed<'_> {
    fn visit<T: Value>(&mut self, setting: &'static Setting, slot: &mut Option<T>) {
        // A command that does not have the flag has no value of it, and a switch that was not typed has the value of clap's.
        let values = self.matches.try_get_many::<T>(setting.name).ok().flatten();
        let values = values.filter(|_| self.matches.value_source(setting.name) == Some(ValueSource::CommandLine));
        *slot = values.into_iter().flatten().cloned().reduce(T::and);
    }
}
