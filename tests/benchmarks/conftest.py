"""The drives of the diagnosis's tests, for benchmarks of it."""

from tests.diagnosis.conftest import drive as drive
from tests.diagnosis.conftest import faultless as faultless
from tests.diagnosis.conftest import husky as husky
from tests.diagnosis.conftest import short_drive as short_drive
