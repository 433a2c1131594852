# The kit on a CPU: docker build -t toolkit . && docker run --rm -v "$PWD:/work" -u "$(id -u):$(id -g)" toolkit doctor
FROM python:3.12-slim AS system
# what Open3D loads, and a software driver for --renderer filament
RUN apt-get update \
    && apt-get install -y --no-install-recommends \
        libegl-mesa0 libegl1 libgl1 libgl1-mesa-dri libgomp1 libidn2-0 libusb-1.0-0 libx11-6 \
    && rm -rf /var/lib/apt/lists/*
RUN pip install --no-cache-dir uv

# for .devcontainer: make sets up the checkout that the editor mounts
FROM system AS development
RUN apt-get update && apt-get install -y --no-install-recommends git make && rm -rf /var/lib/apt/lists/*

FROM system
WORKDIR /kit
COPY pyproject.toml README.md LICENSE ./
COPY toolkit toolkit
# uv finds the PyTorch without CUDA's libraries
RUN uv pip install --system --no-cache --torch-backend cpu ".[studio]"
# any user can write there; compiled code and weights are kept in it
ENV HOME=/tmp
WORKDIR /work
ENTRYPOINT ["toolkit"]
CMD ["--help"]
