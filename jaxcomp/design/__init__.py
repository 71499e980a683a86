"""Design variables and the rules that keep a machine consistent while they change."""

from ._rules import DesignRule as DesignRule
from ._rules import design_rules as design_rules
from ._rules import with_bore as with_bore
