# The companion on a robot: `homeward watch`, which MAVLink or, as JSON lines, the node in ros2/ bring the messages to.
#
#   docker build -t homeward .
#   docker run --rm -i --volume homeward:/var/lib/homeward homeward --stdin --robot husky --state /var/lib/homeward/state.json
#   docker run --rm --network host homeward --mavlink udpin:127.0.0.1:14550 --robot husky
#
# Compiled kernels and the state are kept in the volume. Without one, each start compiles anew.
FROM python:3.13-slim

WORKDIR /opt/homeward
COPY pyproject.toml setup.py README.md LICENSE constraints.txt train.py evaluate.py diagnose.py ./
COPY homeward homeward
COPY envs envs
COPY agents agents
RUN python -m pip install --no-cache-dir --constraint constraints.txt '.[logs]'
RUN useradd --system --create-home --home-dir /var/lib/homeward homeward

USER homeward
WORKDIR /var/lib/homeward
ENV HOMEWARD_CACHE=/var/lib/homeward/kernels
VOLUME /var/lib/homeward
ENTRYPOINT ["homeward", "watch"]
CMD ["--help"]
