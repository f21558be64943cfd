//! Scenes the project makes itself, as binary glTF.
