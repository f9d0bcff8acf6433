"""How near to what was measured on streets a study is: published figures, and tracks of ordinary traffic."""
