"""Camera pictures through OpenGL: a software rasteriser without a GPU, the GPU where there is one.

Import order inside: ``shading`` < ``geometry`` < ``effects`` < ``renderer`` < ``camera``.
"""
