//! Node, Arithmetic and the deployed arithmetic: what users write their own algorithms against.
