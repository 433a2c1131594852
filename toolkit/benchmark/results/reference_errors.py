"""AlexNet's errors under the fifteen corruptions: the reference of the published corruption error."""

ALEXNET_ERRORS = {
    "gaussian_noise": 0.886428,
    "shot_noise": 0.894468,
    "impulse_noise": 0.922640,
    "defocus_blur": 0.819880,
    "glass_blur": 0.826268,
    "motion_blur": 0.785948,
    "zoom_blur": 0.798360,
    "snow": 0.866816,
    "frost": 0.826572,
    "fog": 0.819324,
    "brightness": 0.564592,
    "contrast": 0.853204,
    "elastic_transform": 0.646056,
    "pixelate": 0.717840,
    "jpeg_compression": 0.606500,
}
"""Top-1 error, mean of the five severities on the 50 000 images of ImageNet-C.

Hendrycks and Dietterich, ICLR 2019, Table 1 (there in whole per cent), to the digits of their code in
hendrycks/robustness.
"""

ALEXNET_SOURCE = (
    "errors of AlexNet on ImageNet-C as published (Hendrycks and Dietterich 2019, Table 1; hendrycks/robustness). They "
    "are of ImageNet's 50 000 validation images: on other images, or with patches on them, the quotient does not "
    "compare with a published mCE"
)
UNPATCHED_SOURCE = "errors of the same network on this run's own images without a patch, under the same corruptions"
