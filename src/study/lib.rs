//! Studies: how accurately people annotate, how well readers agree, how many viewers a server carries.

pub mod agreement;
