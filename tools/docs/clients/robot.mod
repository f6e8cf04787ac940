MODULE SqueezetreeRobot
    ! A robot that asks grasp-runtime --serve (tools/docs/serve.md). RobotWare with the option PC Interface.
    ! To be filled in: the target data below, OpenJaws and CloseJaws. Never tried on a controller.

    PERS wobjdata wTable := [FALSE, TRUE, "", [[0, 0, 0], [1, 0, 0, 0]], [[0, 0, 0], [1, 0, 0, 0]]];
    PERS tooldata tTips := [TRUE, [[0, 0, 150], [1, 0, 0, 0]], [1, [0, 0, 50], [1, 0, 0, 0], 0, 0, 0]];
    ! A configuration that reaches the whole table with the hand pointing down.
    PERS robtarget pHome := [[0, 0, 60], [0, 1, 0, 0], [0, 0, 0, 0], [9E9, 9E9, 9E9, 9E9, 9E9, 9E9]];

    VAR socketdev link;
    VAR string word{10};
    VAR num words;
    VAR num low;
    VAR num high;

    ! Locates one part: TRUE, and where it lies.
    FUNC bool LocatePart(INOUT num leaf, INOUT num x, INOUT num y, INOUT num angle)
        VAR string node;
        VAR num counts;
        VAR bool held;
        VAR bool dragged;

        Ask "NEXT";
        WHILE word{1} = "SQUEEZE" DO
            node := word{2};
            Place Number(3), Number(4), Number(5), Number(6);
            CloseJaws Number(7), Number(8), counts, held;
            IF held THEN
                Ask "COUNTS " + NumToStr(counts, 0) + " OBJECT " + node;
            ELSE
                Ask "COUNTS " + NumToStr(counts, 0) + " NONE " + node;
            ENDIF
            dragged := word{1} = "DRAG";
            IF dragged Drag Number(2), Number(3);
            Release;
            IF dragged Ask "NEXT";
        ENDWHILE
        IF word{1} <> "LEAF" RETURN FALSE;
        leaf := Number(2);
        x := Number(3);
        y := Number(4);
        angle := Number(5);
        RETURN TRUE;
    ENDFUNC

    PROC OpenLink(string address, num port)
        SocketCreate link;
        SocketConnect link, address, port;
        Ask "TABLE";
        low := Number(4);
        high := Number(5);
    ENDPROC

    ! One line out and one back, its words in word{1..words}. An error stops the program with the jaws as they are.
    PROC Ask(string line)
        VAR string piece;
        VAR string answer := "";
        VAR num at := 1;
        VAR num gap;

        SocketSend link \Str := line + "\0A";
        WHILE StrFind(answer, 1, "\0A") > StrLen(answer) DO
            SocketReceive link \Str := piece \Time := 10;
            answer := answer + piece;
        ENDWHILE
        answer := StrPart(answer, 1, StrFind(answer, 1, "\0A") - 1);
        words := 0;
        WHILE at <= StrLen(answer) AND words < Dim(word, 1) DO
            gap := StrFind(answer, at, " ");
            words := words + 1;
            word{words} := StrPart(answer, at, gap - at);
            at := gap + 1;
        ENDWHILE
        IF words = 0 OR word{1} = "ERROR" THEN
            TPWrite "squeezetree: " + answer;
            Stop;
            EXIT;
        ENDIF
    ENDPROC

    FUNC num Number(num position)
        VAR num value;

        IF NOT StrToVal(word{position}, value) THEN
            TPWrite "squeezetree: no number: " + word{position};
            Stop;
            EXIT;
        ENDIF
        RETURN value;
    ENDFUNC

    PROC Place(num x, num y, num angle, num opening)
        OpenJaws opening;
        MoveL Down(x, y, high, angle), v200, fine, tTips \WObj := wTable;
        MoveL Down(x, y, low, angle), v50, fine, tTips \WObj := wTable;
    ENDPROC

    PROC Drag(num x, num y)
        VAR robtarget here;

        here := CRobT(\Tool := tTips \WObj := wTable);
        here.trans.x := x;
        here.trans.y := y;
        MoveL here, v50, fine, tTips \WObj := wTable;
    ENDPROC

    PROC Release()
        VAR robtarget here;

        OpenJaws 85;
        here := CRobT(\Tool := tTips \WObj := wTable);
        here.trans.z := high;
        MoveL here, v50, fine, tTips \WObj := wTable;
    ENDPROC

    ! The hand pointing down, turned by an angle about the vertical.
    FUNC robtarget Down(num x, num y, num z, num angle)
        VAR robtarget target;

        target := pHome;
        target.trans := [x, y, z];
        target.rot := OrientZYX(angle, 0, 180);
        RETURN target;
    ENDFUNC

    ! Yours: open to a width in mm, and return once the jaws have settled.
    PROC OpenJaws(num opening)
        Stop;
    ENDPROC

    ! Yours: close at most so fast (mm/s) and so strong (N); return the settled count, and whether something is held.
    PROC CloseJaws(num speed, num force, INOUT num counts, INOUT bool held)
        Stop;
    ENDPROC
ENDMODULE
