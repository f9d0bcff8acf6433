"""All calls of libsumo: reading vehicles and signals, setting what the episode needs, moving mirrored vehicles."""
