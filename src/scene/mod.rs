//! Stage 3: the files of a manifest line become sheets of radiance and inverse depth, in metres.
