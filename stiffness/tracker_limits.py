"""No tracker that is sold measures lengths as wrongly as arms are drawn.

==========  ==========================================================================
Equation    |ratio| <= 5e-4
Source      a laser's wavelength in air changes by 1 ppm a degree and 0.27 ppm a hPa
            (Edlen 1966, "The refractive index of air", Metrologia 2, 71): 50 ppm with
            another day's air and another place's height; cameras are scaled by a bar or
            wand of known length, about 0.1 to 0.3 mm a metre where it is done by hand
Valid       instruments in order, in their own unit of length
Ignores     an inch taken for 25 mm and the like: those are mistakes of the set-up
==========  ==========================================================================
"""

LARGEST_SCALE = 5e-4
"""Share of a length, either way; chosen: the widest above, and half as much again."""
