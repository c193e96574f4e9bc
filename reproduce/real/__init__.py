"""Networks on logs of real lidars: their maps, and maps without a network, are compared with beams that no map had."""
