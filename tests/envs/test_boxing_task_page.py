import doctest

from creative_nao.envs import boxing_task


def test_the_examples_of_the_task_run():
    result = doctest.testmod(boxing_task)
    assert result.attempted > 0
    assert result.failed == 0
