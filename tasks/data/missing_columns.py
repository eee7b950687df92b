"""What is said and asked where the titles of a table name no column of what a test needs."""

from collections.abc import Sequence

from sinew.runner.errors import shown
from sinew.tasks.data.heads import Row
from sinew.tasks.data.possible_columns import titles_by_a_word, titles_by_unit
from sinew.tasks.data.questions import NEITHER, NoColumn, Unclear
from sinew.tasks.data.roles import Role
from sinew.tasks.data.tables import Table

MOST_NAMED = 4  # columns: motion and load along two axes


def _where(table: Table) -> str:
    return f"{table.path}: row {table.title_row}" if table.titles else str(table.path)


def no_column(table: Table, titles: Row, roles: Sequence[Role], *, spare: int) -> NoColumn:
    """What is said where columns of some roles are missing, all at once; ``spare`` columns are of no other role."""
    listed = ", ".join(title or "(no name)" for title in titles[:12]) + (", ..." if len(titles) > 12 else "")
    names = ", nor of ".join(role.name for role in roles)
    perhaps = list(dict.fromkeys(title for role in roles for title in titles_by_a_word(titles, role.quantities)))
    how = "a word in its title" if perhaps else "its unit"
    perhaps = perhaps or list(
        dict.fromkeys(title for role in roles for title in titles_by_unit(titles, role.quantities))
    )
    may_be = f"; by {how}, {' or '.join(map(shown, perhaps[:MOST_NAMED]))} may be one" if perhaps else ""
    measured = [role for role in roles if role.option != "time"]  # times may be told, these not
    remedies = [role.remedy for role in roles if role not in measured or len(measured) <= spare]
    if len(measured) > spare:
        remedies.append(f"a file with {' and '.join(role.option for role in measured)}, which this one does not hold")
    return NoColumn(_where(table), f"no column of {names} among {shown(listed, 200)}{may_be}", "; ".join(remedies))


def which_is(table: Table, titles: Row, free: Sequence[int], role: Role) -> Unclear:
    """The question which of the columns that are left holds what no title says."""
    choices = (*by_title_or_number(titles, free), NEITHER)
    option = f"--{role.option}-column"
    problem = f"no title names the {role.name}"
    return Unclear(
        str(table.path), problem, option, what=role.name, which="which column?", option=option, choices=choices
    )


def by_title_or_number(titles: Row, places: Sequence[int]) -> list[str]:
    """Columns by their titles, or by their numbers where two have one title or one has none."""
    names = [titles[place] for place in places]
    return names if all(names) and len(set(names)) == len(names) else [str(place + 1) for place in places]
