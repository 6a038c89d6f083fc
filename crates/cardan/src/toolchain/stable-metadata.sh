#!/bin/sh
# Cargo's compiler wrapper for board images: replaces the hash that Cargo mixes into symbol names.
# Cargo takes it from the absolute path of each package among other things, and the order of
# functions in the image follows from their names; here it is made of the package's name and
# version, so that the image does not depend on where the checkout lies.
rustc=$1
shift
for argument do
    shift
    case $argument in
        metadata=*) argument=metadata=$CARGO_PKG_NAME-$CARGO_PKG_VERSION ;;
    esac
    set -- "$@" "$argument"
done
exec "$rustc" "$@"
