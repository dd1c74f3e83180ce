"""Sessions: asked for, admitted, given light, ended, and remembered over a restart."""
