# The demo in a container; results appear in ./out, rendered data stay in the volume "fisheye-data".
#
#   docker build --tag fisheye-bench .
#   mkdir -p out
#   docker run --rm --user "$(id -u)" --volume "$PWD/out:/work" --volume fisheye-data:/data fisheye-bench
#
# Any other command stands behind the name: docker run ... fisheye-bench list
FROM python:3.11-slim-bookworm AS build
WORKDIR /source
COPY pyproject.toml README.md LICENSE constraints.txt ./
COPY bench ./bench
COPY datasets ./datasets
COPY reports/baselines ./reports/baselines
COPY reports/leaderboard/leaderboard.json ./reports/leaderboard/
# The second command removes what open3d asks for to draw in browsers and notebooks, which nothing here does.
RUN python -m venv /opt/fisheye-bench \
    && /opt/fisheye-bench/bin/pip install --no-cache-dir --constraint constraints.txt . \
    && /opt/fisheye-bench/bin/pip uninstall --yes dash plotly narwhals flask werkzeug nbformat ipywidgets \
        widgetsnbextension jupyterlab_widgets ipython jedi prompt_toolkit pip

FROM python:3.11-slim-bookworm
# Rendering on arm64 wants libegl1, libgl1 and libx11-6 beside this.
RUN useradd --create-home --uid 1000 bench \
    && install --directory --mode 1777 /work /data
COPY --from=build /opt/fisheye-bench /opt/fisheye-bench
# Whatever user it runs as: data, and caches of libraries, go where everybody may write.
ENV PATH=/opt/fisheye-bench/bin:$PATH FISHEYE_BENCH_DATA=/data/rendered XDG_CACHE_HOME=/data/cache \
    MPLCONFIGDIR=/data/cache/matplotlib
USER 1000
WORKDIR /work
ENTRYPOINT ["fisheye-bench"]
CMD ["run", "demo"]
