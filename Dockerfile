# gmrdata with Blender, for a user without rights:
#   docker build -t gmrdata .
#   docker run --rm -v "$PWD:/work" gmrdata render set.yaml --out set
FROM python:3.11-slim-bookworm AS wheel
COPY . /src
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /dist /src

FROM python:3.11-slim-bookworm
# What bpy loads, then OpenGL without a screen for EEVEE and the previews of Workbench.
RUN apt-get update && apt-get install -y --no-install-recommends \
        libx11-6 libxi6 libxfixes3 libxrender1 libsm6 libgl1 libxkbcommon0 \
        libegl1 libegl-mesa0 libgl1-mesa-dri \
    && rm -rf /var/lib/apt/lists/*
ENV PIP_NO_CACHE_DIR=1 XDG_DATA_HOME=/opt
# The registry's torch is built for CUDA, 5 GB; this one for processors.
ARG TORCH_INDEX=https://download.pytorch.org/whl/cpu
RUN pip install torch==2.13.0 --index-url "$TORCH_INDEX"
COPY constraints.txt /dist/
COPY --from=wheel /dist /dist
RUN pip install -c /dist/constraints.txt /dist/*.whl
RUN gmrdata blender setup
RUN useradd --create-home gmrdata && install -d -o gmrdata /work
USER gmrdata
WORKDIR /work
ENTRYPOINT ["gmrdata"]
