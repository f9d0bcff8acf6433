"""Camera pictures through OpenGL: a software rasteriser without a GPU, the GPU where there is one.

Import order inside: ``shaders`` < geometry < light < ``renderer`` < ``camera``.
"""
