"""Camera pictures through OpenGL: a software rasteriser without a GPU, the GPU where there is one.

Import order inside: ``context`` < ``shaders`` < ``vertices`` < ``static_geometry``, ``vehicle_geometry``, ``shadows`` <
``renderer``.
"""
