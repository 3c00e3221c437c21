//! Two roads to one answer: Schur = dense, marginalised = batch; what must not be known is not; steps go down.

mod dense;
mod descent;
mod gauge;
mod marginal;
mod world;
